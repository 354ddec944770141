//! `lanecraft maneuvers`.

use anyhow::bail;
use clap::{Args, ValueEnum};
use lanecraft_lab::config::nearest;
use lanecraft_lab::maneuvers::{LateralLaw, Maneuver, Outcome, SpeedLaw, Stack, Verdict, catalogue};

use crate::output::{Output, answer};

const EXAMPLES: &str = "\
Examples:
  lanecraft maneuvers
  lanecraft maneuvers cut-in --json
  lanecraft maneuvers --lateral lqr --speed pi

Exits with 2 if a check fails. `short` marks a bound that is known not to be met, with the reason.";

/// Drive the scripted maneuvers and check what comes of them
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Maneuvers {
    /// Only this one
    #[arg(value_name = "NAME")]
    name: Option<String>,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
    /// Who steers
    #[arg(long, value_enum, default_value = "mpc")]
    lateral: Lateral,
    /// Who drives and brakes
    #[arg(long, value_enum, default_value = "mpc")]
    speed: Speed,
}

/// Name of a lateral controller.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Lateral {
    /// Model-predictive control
    Mpc,
    /// Linear-quadratic regulator with curvature feed-forward
    Lqr,
    /// The law of the robot Stanley
    Stanley,
}

/// Name of a speed controller.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Speed {
    /// Model-predictive control
    Mpc,
    /// Proportional-integral control
    Pi,
}

impl Maneuvers {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        let stack = Stack {
            lateral: match self.lateral {
                Lateral::Mpc => LateralLaw::Mpc,
                Lateral::Lqr => LateralLaw::Lqr,
                Lateral::Stanley => LateralLaw::Stanley,
            },
            speed: match self.speed {
                Speed::Mpc => SpeedLaw::Mpc,
                Speed::Pi => SpeedLaw::Pi,
            },
        };
        let chosen = chosen(self.name.as_deref())?;
        let mut failed = Vec::new();
        for maneuver in &chosen {
            let outcome = maneuver.judge(stack)?;
            if !outcome.passed() {
                failed.push(outcome.maneuver.clone());
            }
            if self.json {
                answer(&serde_json::to_string(&outcome)?)?;
            } else {
                print(&outcome)?;
            }
        }
        if !failed.is_empty() {
            bail!("{} of {} maneuvers fail: {}", failed.len(), chosen.len(), failed.join(", "));
        }
        output.note(&match chosen.len() {
            1 => "it passes".to_owned(),
            count => format!("all {count} maneuvers pass"),
        });
        Ok(())
    }
}

/// All maneuvers, or the one of this name.
fn chosen(name: Option<&str>) -> anyhow::Result<Vec<Maneuver>> {
    let all = catalogue();
    let Some(name) = name else { return Ok(all) };
    if let Some(one) = all.iter().find(|maneuver| maneuver.name == name) {
        return Ok(vec![one.clone()]);
    }
    let names: Vec<&str> = all.iter().map(|maneuver| maneuver.name.as_str()).collect();
    let hint =
        nearest(name, names.iter().copied()).map_or_else(String::new, |name| format!("; did you mean `{name}`?"));
    bail!("there is no maneuver `{name}`{hint} (maneuvers: {})", names.join(", "))
}

fn print(outcome: &Outcome) -> anyhow::Result<()> {
    answer(&format!("{:<24} {}", outcome.maneuver, outcome.about))?;
    for verdict in &outcome.verdicts {
        let word = match (verdict.passed, verdict.shortfall) {
            (true, _) => "pass",
            (false, "") => "FAIL",
            (false, _) => "short",
        };
        let unit = verdict.unit;
        let line = format!("  {word:<5} {:<28} {:>9.3} {unit:<6} {}", verdict.check, verdict.measured, bounds(verdict));
        answer(line.trim_end())?;
        if !verdict.passed && !verdict.shortfall.is_empty() {
            answer(&format!("        {}", verdict.shortfall))?;
        }
    }
    Ok(())
}

fn bounds(verdict: &Verdict) -> String {
    match (verdict.low.is_finite(), verdict.high.is_finite()) {
        (true, true) => format!("within {} to {}", short(verdict.low), short(verdict.high)),
        (true, false) => format!("at least {}", short(verdict.low)),
        _ => format!("at most {}", short(verdict.high)),
    }
}

/// Without digits that say nothing.
fn short(value: f64) -> String {
    let text = format!("{value:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
