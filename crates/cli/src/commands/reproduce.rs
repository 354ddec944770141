//! `lanecraft reproduce` and `lanecraft sweep`.

use std::path::PathBuf;

use anyhow::bail;
use clap::{Args, ValueEnum};
use lanecraft_lab::experiments::{
    Budget, BudgetName, Definition, ExperimentError, Outcome, analyze, built_in, built_in_names, curves_of, outcomes,
    overview, rows_of, run,
};
use lanecraft_lab::progress::Progress;
use lanecraft_lab::studies::Study as Kind;
use toml::{Table, Value};

use super::write_report;
use crate::args::{PresetName, ThreadsArg};
use crate::output::{Output, answer};

/// Figures of the paper that a study without training stands for.
const STUDIES: [(&str, Kind); 1] = [("fig11", Kind::PhasePlane)];

/// How much to compute, and where it goes.
#[derive(Debug, Args)]
struct Work {
    /// Folder of the results
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Units (variant and seed) to run at a time; each gets its share of the threads
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: u16,
    #[command(flatten)]
    threads: ThreadsArg,
}

impl Work {
    /// Runs what is missing, prints the tables and writes them, the figures and a page; what came of the claims.
    fn conduct(
        &self,
        definition: &Definition,
        budget: Budget,
        rows_only: bool,
        output: Output,
    ) -> anyhow::Result<Vec<Outcome>> {
        let folder = self.out.join(&definition.name);
        let jobs = usize::from(self.jobs);
        let rows = if rows_only {
            rows_of(definition, budget, &folder)?
        } else {
            let conduct = |progress: &Progress| run(definition, budget, &folder, jobs, progress);
            self.threads.run(|| output.with_progress(conduct))??
        };
        let report =
            analyze(definition, &rows, &curves_of(definition, budget, &folder)?).map_err(ExperimentError::from)?;
        answer(&format!("{}\n\n{}", definition.title, report.text().trim_end()))?;
        write_report(&report, &folder, output)?;
        Ok(outcomes(definition, &rows).map_err(ExperimentError::from)?)
    }
}

const REPRODUCE_EXAMPLES: &str = "\
Examples:
  lanecraft reproduce fig12 --budget quick
  lanecraft reproduce all --budget paper --jobs 2 --out reproduction
  lanecraft reproduce all --budget quick --rows-only --out experiments/results

Each variant of an experiment is trained with several seeds and driven through the same test scenarios. Only what has no row in
DIR/EXPERIMENT/rows.csv is run; an interrupted command goes on where it was. Figures, tables and one page with all claims of the paper are
written beside the rows.";

/// Run the paper's experiments, and ours, and say what came out
#[derive(Debug, Args)]
#[command(after_help = REPRODUCE_EXAMPLES)]
pub(crate) struct Reproduce {
    /// Experiments or figures of the paper: all, fig6, fig7, fig11 to fig15, algorithms, frameworks, heads, shield, weights
    #[arg(value_name = "WHAT", required = true)]
    what: Vec<String>,
    /// How much is computed
    #[arg(long, value_enum, default_value = "quick")]
    budget: BudgetArg,
    /// Run nothing; make tables and figures from the rows that are there
    #[arg(long)]
    rows_only: bool,
    #[command(flatten)]
    work: Work,
}

/// A budget's name.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum BudgetArg {
    /// 3 000 decisions, 2 seeds, 4 scenarios: shows that everything runs
    Smoke,
    /// 40 000 decisions, 5 seeds, 100 scenarios: enough for large effects
    Quick,
    /// 150 000 decisions, 10 seeds, 500 scenarios
    Paper,
}

impl BudgetArg {
    fn budget(self) -> Budget {
        match self {
            Self::Smoke => BudgetName::Smoke,
            Self::Quick => BudgetName::Quick,
            Self::Paper => BudgetName::Paper,
        }
        .budget()
    }
}

impl Reproduce {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        let (definitions, studies) = self.chosen()?;
        for study in studies {
            let report = self.work.threads.run(|| study.run())??;
            answer(report.text().trim_end())?;
            write_report(&report, &self.work.out.join(study.name()), output)?;
        }
        let mut found = Vec::new();
        for definition in &definitions {
            found.extend(self.work.conduct(definition, self.budget.budget(), self.rows_only, output)?);
        }
        if found.is_empty() {
            return Ok(());
        }
        let page = overview(&found);
        answer(&format!("\n{}", page.text().trim_end()))?;
        write_report(&page, &self.work.out, output)
    }

    /// What to do, each once, in the order asked for.
    fn chosen(&self) -> anyhow::Result<(Vec<Definition>, Vec<Kind>)> {
        let (mut definitions, mut studies): (Vec<Definition>, Vec<Kind>) = (Vec::new(), Vec::new());
        let all = || built_in_names().into_iter().chain(STUDIES.map(|(figure, _)| figure.to_owned()));
        let wanted = self.what.iter().flat_map(|what| if what == "all" { all().collect() } else { vec![what.clone()] });
        for name in wanted {
            if let Some((_, study)) = STUDIES.into_iter().find(|(figure, _)| *figure == name) {
                studies.retain(|other| *other != study);
                studies.push(study);
                continue;
            }
            let definition = built_in(&name)?;
            if !definitions.contains(&definition) {
                definitions.push(definition);
            }
        }
        Ok((definitions, studies))
    }
}

const SWEEP_EXAMPLES: &str = "\
Examples:
  lanecraft sweep --vary learner.discount=0.9,0.95,0.97 --seeds 3 --out sweeps/discount
  lanecraft sweep --vary learner.algorithm=dqn,double-dqn --vary learner.batch=32,64 --decisions 40000 --out sweeps/batch
  lanecraft sweep mine.toml --seeds 10 --jobs 2 --out sweeps/mine

Every combination of the values is a variant, trained with every seed and driven through the same test scenarios. A file has the form of
those in `experiments`, and can also vary what is for training or test alone. Only what has no row yet is run.";

/// Train and compare variants of your own: keys varied over values, or a file
#[derive(Debug, Args)]
#[command(after_help = SWEEP_EXAMPLES)]
pub(crate) struct Sweep {
    /// File that defines the experiment
    #[arg(value_name = "FILE", value_parser = crate::args::file, conflicts_with_all = ["vary", "preset", "assignments"])]
    file: Option<PathBuf>,
    /// Key and its values; may be repeated
    #[arg(long, value_name = "KEY=V1,V2,…")]
    vary: Vec<String>,
    /// Complete set of numbers to start from
    #[arg(long, value_enum, default_value = "default")]
    preset: PresetName,
    /// One number laid over the preset for all; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    assignments: Vec<String>,
    /// Decisions of each training
    #[arg(long, value_name = "N", default_value_t = 40_000)]
    decisions: u64,
    /// Training seeds of each variant
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    seeds: u64,
    /// Test scenarios
    #[arg(long, value_name = "N", default_value_t = 100)]
    episodes: usize,
    #[command(flatten)]
    work: Work,
}

impl Sweep {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        let budget = Budget { decisions: self.decisions, seeds: self.seeds, episodes: self.episodes };
        let definition = self.definition()?;
        self.work.conduct(&definition, budget, false, output).map(drop)
    }

    fn definition(&self) -> anyhow::Result<Definition> {
        if let Some(path) = &self.file {
            return Ok(Definition::read(path)?);
        }
        if self.vary.is_empty() {
            bail!("nothing to vary: name a file, or a key and its values with --vary KEY=V1,V2");
        }
        let mut base = Table::new();
        for assignment in &self.assignments {
            let (key, value) = assigned(assignment)?;
            base.insert(key.to_owned(), scalar(value));
        }
        let mut keys = Vec::new();
        for varied in &self.vary {
            let (key, values) = assigned(varied)?;
            keys.push((key.to_owned(), split(values).into_iter().map(scalar).collect()));
        }
        Ok(Definition::grid("sweep", self.preset.preset(), base, &keys)?)
    }
}

fn assigned(text: &str) -> anyhow::Result<(&str, &str)> {
    match text.split_once('=') {
        Some((key, value)) => Ok((key.trim(), value.trim())),
        None => bail!("`{text}` is no assignment: it must be KEY=VALUE"),
    }
}

/// The values between commas that are in no brackets.
fn split(values: &str) -> Vec<&str> {
    let mut depth = 0_i32;
    let outside = |c: char| {
        depth += i32::from("[{".contains(c)) - i32::from("]}".contains(c));
        c == ',' && depth == 0
    };
    values.split(outside).map(str::trim).collect()
}

/// A TOML value; a bare word stands for a string.
fn scalar(text: &str) -> Value {
    let table: Option<Table> = format!("value = {text}").parse().ok();
    table.and_then(|mut table| table.remove("value")).unwrap_or_else(|| Value::String(text.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::{scalar, split};

    #[test]
    fn values_are_split_outside_of_brackets_and_bare_words_are_strings() {
        assert_eq!(split("[1, 2], [3],dqn"), ["[1, 2]", "[3]", "dqn"]);
        assert_eq!(scalar("dqn").as_str(), Some("dqn"));
        assert_eq!(scalar("[1, 2]").as_array().map(Vec::len), Some(2));
        assert_eq!(scalar("0.5").as_float(), Some(0.5));
    }
}
