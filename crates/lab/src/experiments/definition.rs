//! What an experiment is: its variants, how they are trained and tested, and what the paper claims of them.

use std::collections::BTreeSet;
use std::path::Path;

use include_dir::{Dir, include_dir};
use serde::{Deserialize, Serialize};
use toml::Table;

use super::rows::UnitRow;
use crate::baselines::{Rule, UnknownRule};
use crate::config::{ConfigFileError, Preset, RunConfig, unknown_name};

static FILES: Dir = include_dir!("$CARGO_MANIFEST_DIR/../../experiments");

/// How much is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Decisions of a training.
    pub decisions: u64,
    /// Training seeds of each variant that learns.
    pub seeds: u64,
    /// Test scenarios, the same for all.
    pub episodes: usize,
}

/// A budget's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BudgetName {
    /// Shows that everything runs; its figures mean nothing.
    Smoke,
    /// Enough for large effects.
    Quick,
    /// Ten seeds and 500 scenarios.
    Paper,
}

impl BudgetName {
    /// What it stands for.
    pub fn budget(self) -> Budget {
        match self {
            Self::Smoke => Budget { decisions: 3_000, seeds: 2, episodes: 4 },
            Self::Quick => Budget { decisions: 40_000, seeds: 5, episodes: 100 },
            Self::Paper => Budget { decisions: 150_000, seeds: 10, episodes: 500 },
        }
    }
}

/// An experiment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Definition {
    /// Its name: that of its file, and of its folder among the results.
    #[serde(skip)]
    pub name: String,
    /// Headline.
    pub title: String,
    /// What is compared and why, a few sentences for the page.
    pub summary: String,
    /// Figures and tables of the paper that it stands for, for example `fig12`; may be empty.
    #[serde(default)]
    pub figures: Vec<String>,
    /// The preset under everything.
    pub preset: String,
    /// Laid over the preset for all variants.
    #[serde(default)]
    pub base: Table,
    /// Whom the others are compared with: the name of a variant.
    pub reference: String,
    /// What is compared.
    pub variants: Vec<Variant>,
    /// What the paper says of it.
    #[serde(default)]
    pub claims: Vec<Claim>,
}

/// One configuration, or one rule, of an experiment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Variant {
    /// Its name.
    pub name: String,
    /// Where it stands among the variants, such as its number of heads; if all have one, it is tested whether figures rise with it.
    pub x: Option<f64>,
    /// The rule that drives, such as `rule:best-lane`; empty: a policy that is trained.
    pub policy: String,
    /// Laid over the base, for training and test.
    pub set: Table,
    /// Laid over that for training alone.
    pub train: Table,
    /// Laid over that for the test alone.
    pub test: Table,
}

/// What the paper says: by how much a figure of one variant differs from that of another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Claim {
    /// Where it says so, for example `Fig. 12`.
    pub source: String,
    /// Of what.
    pub metric: Metric,
    /// Of which variant.
    pub variant: String,
    /// Against which.
    pub against: String,
    /// Relative difference, %.
    pub change_percent: f64,
}

/// A figure of a unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Metric {
    /// Mean speed, m/s.
    Speed,
    /// Reward of a tick in its fixed scoring form.
    Reward,
    /// Share of episodes that ended in a collision.
    Collisions,
}

impl Metric {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Speed => "speed",
            Self::Reward => "reward per tick",
            Self::Collisions => "collisions per episode",
        }
    }

    /// Of a row.
    pub fn of(self, row: &UnitRow) -> f64 {
        match self {
            Self::Speed => row.speed_mps,
            Self::Reward => row.reward_per_tick,
            Self::Collisions => row.collisions as f64 / row.episodes as f64,
        }
    }
}

/// Why a definition cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DefinitionError {
    /// The file cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// Which.
        path: std::path::PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is no definition.
    #[error("{name}: {source}")]
    Syntax {
        /// File or name of the experiment.
        name: String,
        /// Why, with the line.
        source: Box<toml::de::Error>,
    },
    /// A variant's configuration is wrong.
    #[error("experiment `{experiment}`, variant `{variant}`: {source}")]
    Config {
        /// The experiment.
        experiment: String,
        /// The variant.
        variant: String,
        /// Key, value and what is allowed.
        source: Box<ConfigFileError>,
    },
    /// A name that does not exist, twice the same name, or no variant at all.
    #[error("experiment `{experiment}`: {message}")]
    Names {
        /// The experiment.
        experiment: String,
        /// What is wrong.
        message: String,
    },
    /// There is no built-in experiment of this name.
    #[error("{0}")]
    Unknown(String),
}

/// Names of the experiments that come with the program.
pub fn built_in_names() -> Vec<String> {
    let toml = FILES.files().filter(|file| file.path().extension().is_some_and(|extension| extension == "toml"));
    let mut names: Vec<String> = toml.map(|file| file.path().with_extension("").display().to_string()).collect();
    names.sort();
    names
}

/// The experiment of this name, or the one that stands for this figure of the paper.
///
/// # Errors
/// If there is none.
pub fn built_in(name_or_figure: &str) -> Result<Definition, DefinitionError> {
    let all = built_in_names().into_iter().map(|name| {
        let file = FILES.get_file(format!("{name}.toml")).expect("a name that was listed");
        Definition::from_text(&name, file.contents_utf8().unwrap_or_default())
    });
    let all = all.collect::<Result<Vec<_>, _>>()?;
    let fits = |definition: &&Definition| {
        definition.name == name_or_figure || definition.figures.iter().any(|figure| figure == name_or_figure)
    };
    all.iter().find(fits).cloned().ok_or_else(|| {
        let names: Vec<&str> = all
            .iter()
            .flat_map(|definition| definition.figures.iter().chain([&definition.name]))
            .map(String::as_str)
            .collect();
        DefinitionError::Unknown(unknown_name("experiment", name_or_figure, &names))
    })
}

impl Definition {
    /// The experiment in a file.
    ///
    /// # Errors
    /// If it cannot be read, or is wrong.
    pub fn read(path: &Path) -> Result<Self, DefinitionError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| DefinitionError::Read { path: path.to_owned(), source })?;
        let name = path.file_stem().map_or_else(|| "experiment".into(), |stem| stem.to_string_lossy().into_owned());
        Self::from_text(&name, &text)
    }

    /// The experiment that varies each of these keys over its values, in all combinations, on a preset.
    ///
    /// # Errors
    /// If a key or a value is wrong.
    pub fn grid(
        name: &str,
        preset: Preset,
        base: Table,
        keys: &[(String, Vec<toml::Value>)],
    ) -> Result<Self, DefinitionError> {
        let mut variants = vec![Variant::default()];
        for (key, values) in keys {
            let with = |variant: &Variant, value: &toml::Value| {
                let mut variant = variant.clone();
                let assignment = format!("{key}={}", shown(value));
                variant.name = if variant.name.is_empty() { assignment } else { variant.name + " " + &assignment };
                variant.set.insert(key.clone(), value.clone());
                variant
            };
            variants =
                variants.iter().flat_map(|variant| values.iter().map(move |value| with(variant, value))).collect();
        }
        let definition = Self {
            name: name.to_owned(),
            title: format!("Sweep {name}"),
            summary: String::new(),
            figures: Vec::new(),
            preset: preset.name().to_owned(),
            base,
            reference: variants[0].name.clone(),
            variants,
            claims: Vec::new(),
        };
        definition.checked()
    }

    fn from_text(name: &str, text: &str) -> Result<Self, DefinitionError> {
        let syntax = |source| DefinitionError::Syntax { name: name.to_owned(), source: Box::new(source) };
        let definition: Self = toml::from_str(text).map_err(syntax)?;
        Self { name: name.to_owned(), ..definition }.checked()
    }

    fn checked(self) -> Result<Self, DefinitionError> {
        let names: Vec<&str> = self.variants.iter().map(|variant| variant.name.as_str()).collect();
        let named = self.claims.iter().flat_map(|claim| [&claim.variant, &claim.against]).chain([&self.reference]);
        for name in named {
            if !names.contains(&name.as_str()) {
                return Err(self.wrong(unknown_name("variant", name, &names)));
            }
        }
        if names.iter().collect::<BTreeSet<_>>().len() < names.len() {
            return Err(self.wrong("two variants have the same name".to_owned()));
        }
        for variant in &self.variants {
            self.rule(variant)?;
            self.configs(variant, BudgetName::Smoke.budget(), 0)?;
        }
        Ok(self)
    }

    fn wrong(&self, message: String) -> DefinitionError {
        DefinitionError::Names { experiment: self.name.clone(), message }
    }

    /// The rule that drives a variant; none if it learns.
    pub(super) fn rule(&self, variant: &Variant) -> Result<Option<Rule>, DefinitionError> {
        if variant.policy.is_empty() {
            return Ok(None);
        }
        let name = variant.policy.strip_prefix("rule:").unwrap_or(&variant.policy);
        name.parse().map(Some).map_err(|_: UnknownRule| self.wrong(unknown_name("rule", name, &Rule::NAMES)))
    }

    /// The configurations in which a variant is trained and tested.
    pub(super) fn configs(
        &self,
        variant: &Variant,
        budget: Budget,
        seed: u64,
    ) -> Result<[RunConfig; 2], DefinitionError> {
        let names = Preset::ALL.map(Preset::name);
        let preset = Preset::ALL.into_iter().find(|preset| preset.name() == self.preset);
        let preset = preset.ok_or_else(|| self.wrong(unknown_name("preset", &self.preset, &names)))?;
        let mut run = Table::new();
        run.insert("training.seed".into(), (seed as i64).into());
        run.insert("training.decisions".into(), (budget.decisions as i64).into());
        run.insert("evaluation.episodes".into(), (budget.episodes as i64).into());
        let resolve = |own: &Table| {
            RunConfig::resolve_tables(preset, &[&run, &self.base, &variant.set, own]).map_err(|source| {
                DefinitionError::Config {
                    experiment: self.name.clone(),
                    variant: variant.name.clone(),
                    source: Box::new(source),
                }
            })
        };
        Ok([resolve(&variant.train)?, resolve(&variant.test)?])
    }
}

/// A value as on the command line: strings without quotes.
fn shown(value: &toml::Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"
        title = "T"
        summary = "S"
        preset = "default"
        reference = "a"
        base = { "road.lanes" = 2 }
        [[variants]]
        name = "a"
        set = { learner.discount = 0.9 }
        test = { traffic.density_veh_per_km_lane = 20 }
        [[variants]]
        name = "b"
        policy = "rule:best-lane"
    "#;

    #[test]
    fn variants_are_laid_over_the_base_for_training_and_test_apart() {
        let definition = Definition::from_text("t", TEXT).unwrap();
        let [train, test] = definition.configs(&definition.variants[0], BudgetName::Quick.budget(), 7).unwrap();
        assert_eq!((train.training.seed, train.training.decisions, train.learner.discount), (7, 40_000, 0.9));
        assert_eq!((train.environment.road.lanes, test.environment.road.lanes), (2, 2));
        assert_eq!(train.environment.traffic.density_veh_per_km_lane, 14.0);
        assert_eq!(test.environment.traffic.density_veh_per_km_lane, 20.0);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        for (old, new, said) in [
            ("reference = \"a\"", "reference = \"aa\"", "there is no variant `aa`"),
            ("name = \"b\"", "name = \"a\"", "two variants have the same name"),
            ("rule:best-lane", "rule:best-lan", "did you mean `best-lane`"),
            ("learner.discount = 0.9", "learner.discuont = 0.9", "variant `a`"),
            ("learner.discount = 0.9", "learner.discount = 9", "`learner.discount` is 9"),
            ("preset = \"default\"", "preset = \"defualt\"", "did you mean `default`"),
            ("title = \"T\"", "titel = \"T\"", "unknown field `titel`"),
        ] {
            let message = Definition::from_text("t", &TEXT.replace(old, new)).unwrap_err().to_string();
            assert!(message.contains(said), "{message}");
        }
    }

    #[test]
    fn a_grid_has_all_combinations() {
        let keys = [
            ("learner.heads".to_owned(), vec![2.into(), 4.into()]),
            ("learner.algorithm".to_owned(), vec!["dqn".into(), "double-dqn".into()]),
        ];
        let definition = Definition::grid("g", Preset::Default, Table::new(), &keys).unwrap();
        let names: Vec<&str> = definition.variants.iter().map(|variant| variant.name.as_str()).collect();
        assert_eq!(names.len(), 4);
        assert_eq!(names[1], "learner.heads=2 learner.algorithm=double-dqn");
        let bad = [("learner.heads".to_owned(), vec![99.into()])];
        assert!(Definition::grid("g", Preset::Default, Table::new(), &bad).is_err());
    }

    #[test]
    fn every_built_in_experiment_is_sound_and_found_by_its_figures() {
        assert!(!built_in_names().is_empty());
        for name in built_in_names() {
            let definition = built_in(&name).unwrap();
            for figure in &definition.figures {
                assert_eq!(built_in(figure).unwrap().name, name);
            }
        }
        assert!(built_in("fig122").unwrap_err().to_string().contains("did you mean `fig12`"));
    }
}
