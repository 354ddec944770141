//! The configuration of a run: a preset, laid over by a file and by assignments, checked, and written with every result.
//!
//! Each section of the TOML text is one struct of the module it configures. A preset is a complete text, so that its keys are the keys
//! that exist; whatever is laid over it is checked key by key ([`overlay`]) before the structs are built and validated.

pub mod error;
pub mod overlay;

use std::io::Read as _;
use std::path::Path;

use lanecraft_drive::config::{ConfigError, check_range};
pub use lanecraft_drive::env::Config as EnvironmentConfig;
use lanecraft_drive::kinematic::KinematicConfig;
use lanecraft_drive::predict::ModelSource;
use lanecraft_learn::LearnerConfig;
use lanecraft_learn::irl::IrlConfig;
use serde::{Deserialize, Serialize};
use toml::Table;

pub use error::{ConfigFileError, Origin, PredictorFileError, PredictorFileProblem, SectionError};
pub use overlay::nearest;

use overlay::Overlay;

use crate::candidates::CandidateConfig;
use crate::predictor::PredictorConfig;

/// A named complete configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// What works best.
    Default,
    /// As the paper has it, wherever it says.
    Paper,
}

impl Preset {
    /// All presets.
    pub const ALL: [Self; 2] = [Self::Default, Self::Paper];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Default => "default",
            Self::Paper => "paper",
        }
    }

    /// Its complete TOML text.
    pub fn text(self) -> &'static str {
        match self {
            Self::Default => include_str!("../../../presets/default.toml"),
            Self::Paper => include_str!("../../../presets/paper.toml"),
        }
    }

    fn table(self) -> Table {
        self.text().parse().expect("the presets are TOML, which a test of this module holds")
    }
}

/// Largest seed of a run: seeds of scenarios are made of it and of two more numbers, see [`SeedRole::scenario_seed`].
pub const MAX_SEED: u64 = (1 << 20) - 1;

/// What a scenario is for. Scenarios of different roles never share a seed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SeedRole {
    /// A learner learns from it.
    Training,
    /// Settings are chosen by it.
    Tuning,
    /// Results are reported of it, and nothing is chosen by it.
    Test,
    /// A predictor learns from its traffic.
    Prediction,
}

impl SeedRole {
    /// The seed of the scenario with this index in the series `seed`.
    ///
    /// Role (2 bits), seed (20 bits) and index (30 bits) stand side by side, so no two scenarios share a seed, and all seeds fit the
    /// 53 bits that JSON readers keep exactly. Seeds and indices beyond that wrap around.
    pub fn scenario_seed(self, seed: u64, index: u64) -> u64 {
        let role: u64 = match self {
            Self::Training => 0,
            Self::Tuning => 1,
            Self::Test => 2,
            Self::Prediction => 3,
        };
        role << 50 | (seed & MAX_SEED) << 30 | (index & ((1 << 30) - 1))
    }
}

/// How a policy is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainingConfig {
    /// Seed of everything random in the run, 0 to [`MAX_SEED`].
    pub seed: u64,
    /// Decisions to take in all, over all environments. The paper does not say.
    pub decisions: u64,
    /// Environments stepped side by side. The paper has one.
    pub environments: usize,
    /// Decisions between two lines of the log.
    pub log_every_decisions: u64,
    /// Decisions between two checkpoints.
    pub checkpoint_every_decisions: u64,
}

impl Default for TrainingConfig {
    fn default() -> Self {
        Self {
            seed: 0,
            decisions: 150_000,
            environments: 16,
            log_every_decisions: 1_000,
            checkpoint_every_decisions: 10_000,
        }
    }
}

impl TrainingConfig {
    /// Checks every field.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_range("training.seed", self.seed as f64, 0.0, MAX_SEED as f64)?;
        check_range("training.decisions", self.decisions as f64, 1.0, 1e9)?;
        check_range("training.environments", self.environments as f64, 1.0, 4096.0)?;
        check_range("training.log_every_decisions", self.log_every_decisions as f64, 1.0, 1e9)?;
        check_range("training.checkpoint_every_decisions", self.checkpoint_every_decisions as f64, 1.0, 1e9)
    }
}

/// How a policy is judged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EvaluationConfig {
    /// Test episodes, the same scenarios for every policy. The paper has ten.
    pub episodes: usize,
    /// Length of an episode, s. The paper does not say.
    pub episode_s: f64,
    /// Which series of test scenarios, 0 to [`MAX_SEED`]; training never sees any of them.
    pub seed: u64,
}

impl Default for EvaluationConfig {
    fn default() -> Self {
        Self { episodes: 200, episode_s: 60.0, seed: 0 }
    }
}

impl EvaluationConfig {
    /// Checks every field.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_range("evaluation.episodes", self.episodes as f64, 2.0, 1e7)?;
        check_range("evaluation.episode_s", self.episode_s, 1.0, 3600.0)?;
        check_range("evaluation.seed", self.seed as f64, 0.0, MAX_SEED as f64)
    }
}

/// Everything that decides what a run computes. How many threads compute it is not in here, because it changes nothing.
///
/// In TOML the sections of the environment stand beside those of the learner and of the lab.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunConfig {
    /// The sections of the environment: `[env]`, `[road]`, `[traffic]`, …
    pub environment: EnvironmentConfig,
    /// Section `[candidates]`.
    pub candidates: CandidateConfig,
    /// Section `[irl]`.
    pub irl: IrlConfig,
    /// Section `[predictor]`.
    pub predictor: PredictorConfig,
    /// Section `[learner]`.
    pub learner: LearnerConfig,
    /// Section `[training]`.
    pub training: TrainingConfig,
    /// Section `[evaluation]`.
    pub evaluation: EvaluationConfig,
}

/// The sections that are not the environment's.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LabSections {
    candidates: CandidateConfig,
    irl: IrlConfig,
    predictor: PredictorConfig,
    learner: LearnerConfig,
    training: TrainingConfig,
    evaluation: EvaluationConfig,
}

impl LabSections {
    const NAMES: [&'static str; 6] = ["candidates", "irl", "predictor", "learner", "training", "evaluation"];
}

/// The fast environment, laid over by `values`, whose keys may be nested or dotted, checked and validated.
pub fn resolve_kinematic(values: &Table) -> Result<KinematicConfig, ConfigFileError> {
    let table = Table::try_from(KinematicConfig::default()).expect("all sections are tables of plain values");
    let mut overlay = Overlay::new("fast", table, |table| table.clone().try_into::<KinematicConfig>().map(drop));
    overlay.values(values)?;
    let config: KinematicConfig =
        overlay.table().clone().try_into().expect("each key was checked when it was laid over");
    config.validate().map_err(|source| {
        let source = SectionError::from(source);
        ConfigFileError::Invalid { origin: overlay.origin(source.key()), source }
    })?;
    Ok(config)
}

/// What to say of a name that does not exist.
pub fn unknown_name(what: &str, name: &str, names: &[&str]) -> String {
    let names_owned: Vec<String> = names.iter().map(ToString::to_string).collect();
    let near = nearest(name, names.iter().copied());
    format!("there is no {what} `{name}`{}", error::suggestion(near, &names_owned))
}

impl RunConfig {
    /// The preset, laid over by `file`, then by `assignments` (`key=value`) in their order, checked and validated.
    pub fn resolve(preset: Preset, file: Option<&Path>, assignments: &[String]) -> Result<Self, ConfigFileError> {
        let mut overlay = Self::overlay(preset);
        if let Some(path) = file {
            overlay.file(path)?;
        }
        for assignment in assignments {
            overlay.set(assignment)?;
        }
        Self::validated(&overlay)
    }

    /// The preset, laid over by `values`, whose keys may be nested or dotted, checked and validated.
    pub fn resolve_table(preset: Preset, values: &Table) -> Result<Self, ConfigFileError> {
        Self::resolve_tables(preset, &[values])
    }

    /// The same with several tables, one laid over the other.
    pub fn resolve_tables(preset: Preset, layers: &[&Table]) -> Result<Self, ConfigFileError> {
        let mut overlay = Self::overlay(preset);
        layers.iter().try_for_each(|values| overlay.values(values))?;
        Self::validated(&overlay)
    }

    /// The complete configuration in `file`, laid over by `values`.
    pub fn resolve_table_over(file: &Path, values: &Table) -> Result<Self, ConfigFileError> {
        let mut overlay = Self::overlay(Preset::Default);
        overlay.file(file)?;
        overlay.values(values)?;
        Self::validated(&overlay)
    }

    /// The configuration of a text written by [`Self::to_toml`]; `path` is where the text came from.
    pub fn from_toml(path: &Path, text: &str) -> Result<Self, ConfigFileError> {
        let mut overlay = Self::overlay(Preset::Default);
        overlay.text(path, text)?;
        Self::validated(&overlay)
    }

    /// The complete configuration as TOML, the same text for the same configuration.
    pub fn to_toml(&self) -> String {
        toml::to_string(&self.to_table()).expect("all sections are tables of plain values")
    }

    /// Checks every section.
    pub fn validate(&self) -> Result<(), SectionError> {
        self.environment.validate()?;
        self.candidates.validate()?;
        self.irl.validate()?;
        self.predictor.validate()?;
        self.learner.validate()?;
        self.training.validate()?;
        Ok(self.evaluation.validate()?)
    }

    fn to_table(&self) -> Table {
        let lab = LabSections {
            candidates: self.candidates.clone(),
            irl: self.irl.clone(),
            predictor: self.predictor.clone(),
            learner: self.learner.clone(),
            training: self.training.clone(),
            evaluation: self.evaluation.clone(),
        };
        let lab = Table::try_from(lab).expect("all sections are tables of plain values");
        let mut table = Table::try_from(&self.environment).expect("all sections are tables of plain values");
        table.extend(lab);
        table
    }

    fn from_table(table: &Table) -> Result<Self, toml::de::Error> {
        let (lab, environment): (Table, Table) =
            table.clone().into_iter().partition(|(section, _)| LabSections::NAMES.contains(&section.as_str()));
        let LabSections { candidates, irl, predictor, learner, training, evaluation } = lab.try_into()?;
        Ok(Self { environment: environment.try_into()?, candidates, irl, predictor, learner, training, evaluation })
    }

    /// A complete preset, to lay something over.
    fn overlay(preset: Preset) -> Overlay {
        Overlay::new(preset.name(), preset.table(), |table| Self::from_table(table).map(drop))
    }

    fn validated(overlay: &Overlay) -> Result<Self, ConfigFileError> {
        let mut config = Self::from_table(overlay.table()).expect("each key was checked when it was laid over");
        load_predictor(&mut config.environment.prediction.model)
            .map_err(SectionError::from)
            .and_then(|()| config.validate())
            .map_err(|source| ConfigFileError::Invalid { origin: overlay.origin(source.key()), source })?;
        Ok(config)
    }
}

/// Largest file of weights that is read, bytes: ten times the widest network's.
const WEIGHTS_LIMIT: u64 = 64 << 20;

/// Loads the predictor's weights, if they are those of a file.
fn load_predictor(source: &mut ModelSource) -> Result<(), Box<PredictorFileError>> {
    let Some(path) = source.path().map(str::to_owned) else { return Ok(()) };
    let read = || {
        let mut bytes = Vec::new();
        std::fs::File::open(&path)?.take(WEIGHTS_LIMIT).read_to_end(&mut bytes).map(|_| bytes)
    };
    let loaded = read().map_err(PredictorFileProblem::from).and_then(|bytes| Ok(source.load(&bytes)?));
    loaded.map_err(|reason| Box::new(PredictorFileError { path, reason }))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::overlay::dotted_keys;
    use super::{MAX_SEED, Preset, RunConfig, SeedRole};

    fn set(assignments: &[&str]) -> Result<RunConfig, String> {
        let assignments: Vec<String> = assignments.iter().map(ToString::to_string).collect();
        RunConfig::resolve(Preset::Default, None, &assignments).map_err(|error| error.to_string())
    }

    #[test]
    fn preset_default_is_the_default_and_every_preset_has_every_key() {
        assert_eq!(set(&[]), Ok(RunConfig::default()));
        let keys = dotted_keys(&RunConfig::default().to_table());
        for preset in Preset::ALL {
            assert_eq!(dotted_keys(&preset.table()), keys, "preset {}", preset.name());
            RunConfig::resolve(preset, None, &[]).unwrap();
        }
    }

    #[test]
    fn every_key_of_a_preset_is_explained() {
        for preset in Preset::ALL {
            let lines: Vec<&str> = preset.text().lines().collect();
            for pair in lines.windows(2).filter(|pair| pair[1].contains('=') && !pair[1].starts_with('#')) {
                assert!(pair[0].starts_with("# "), "preset {}: no comment above `{}`", preset.name(), pair[1]);
            }
        }
    }

    #[test]
    fn the_resolved_text_reads_back() {
        let config = set(&["training.seed=7", "env.episode_s=30", "evaluation.episodes=10"]).unwrap();
        assert_eq!((config.training.seed, config.environment.env.episode_s), (7, 30.0));
        assert_eq!(RunConfig::from_toml(Path::new("config.toml"), &config.to_toml()).unwrap(), config);
    }

    #[test]
    fn a_value_out_of_range_is_named_with_its_range_and_its_place() {
        let message = set(&["evaluation.episode_s=0.1"]).unwrap_err();
        assert_eq!(message, "command line: `evaluation.episode_s` is 0.1, but must be in 1..=3600");
        assert!(set(&["training.seed=-1"]).unwrap_err().contains("`training.seed` is -1"));
    }

    /// Each key of the configuration against each kind of bad value: a message that names the key, and never a panic.
    #[test]
    fn every_key_refuses_every_kind_of_bad_value() {
        for key in dotted_keys(&Preset::Default.table()) {
            for value in ["nan", "inf", "-inf", "qqq", "[[[]]]", "1979-05-27", "{ a = 1 }", "-1e300"] {
                let message = set(&[&format!("{key}={value}")]).unwrap_err();
                assert!(message.contains(&format!("`{key}`")), "{key}={value}: {message}");
            }
            let misspelt = format!("{key}q");
            let message = set(&[&format!("{misspelt}=1")]).unwrap_err();
            assert!(message.contains(&format!("did you mean `{key}`?")), "{message}");
        }
    }

    #[test]
    fn weights_are_loaded_or_refused_with_file_and_reason() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("weights.safetensors");
        let assignment = format!("prediction.model={}", path.display());
        let resolved = || set(&[&assignment, "prediction.predictor=lstm"]);
        assert!(resolved().unwrap_err().contains("weights.safetensors\", which must be built-in"));
        std::fs::write(&path, b"nonsense, but long enough").unwrap();
        assert!(resolved().unwrap_err().contains("the tensor file declares a header of"));
        let built_in = lanecraft_drive::predict::lstm::LstmModel::built_in();
        std::fs::write(&path, built_in.to_bytes().unwrap()).unwrap();
        assert_eq!(resolved().unwrap().environment.prediction.model.loaded().unwrap(), built_in);
    }

    #[test]
    fn scenarios_of_different_roles_seeds_or_indices_differ() {
        let mut seeds = Vec::new();
        for role in [SeedRole::Training, SeedRole::Tuning, SeedRole::Test, SeedRole::Prediction] {
            for seed in [0, 1, MAX_SEED] {
                seeds.extend([0, 1, (1 << 30) - 1].map(|index| role.scenario_seed(seed, index)));
            }
        }
        assert!(seeds.iter().all(|&seed| seed < 1 << 53));
        let count = seeds.len();
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), count);
    }
}
