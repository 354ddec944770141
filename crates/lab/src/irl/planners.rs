//! The planner with a learned reward beside others, on lane changes that people made.
//!
//! Each planner is asked at the moment at which the driver began, and sees what the driver's car could see: the vehicles of the two lanes
//! and their speeds, forecast at constant speed. Compared are ours with the weights of the preset, with the paper's features learned
//! from the other groups, and with all features and three ends; a Frenet sampling planner (Werling, Ziegler, Kammel and Thrun, 2010) with
//! the usual weights of its cost and a collision check along its path; and the one of its candidates with the least jerk.
//!
//! All choose among the same durations. Frenet's check knows no leader who brakes and no follower, so that it refuses less.

use std::sync::Arc;

use lanecraft_drive::config::ConfigError;
use lanecraft_drive::plan::{Motion, Planner, PlannerConfig, Quintic, Refusal};
use lanecraft_drive::predict::{Forecast, Predictor};
use lanecraft_drive::road::{LaneIndex, Road, RoadConfig, Side, Topology};
use lanecraft_drive::scene::{Neighbor, Scene, VehicleId};
use lanecraft_drive::vehicle::{VehicleParams, VehicleState};
use lanecraft_learn::irl::IrlConfig;

use super::{LearnError, learn};
use crate::candidates::{CandidateConfig, Choice, Choices};
use crate::demonstrations::{Demonstration, Demonstrations};
use crate::metrics::Interval;
use crate::stats::mean_interval;
use crate::studies::{StudyReport, Table};

/// Why planners could not be compared.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlannersError {
    /// A reward could not be learned.
    #[error(transparent)]
    Learn(#[from] LearnError),
    /// A planner or a road could not be set up.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// No scene that all planners accept is left.
    #[error("there are fewer than two lane changes that all planners accept")]
    NothingInCommon,
}

/// Longest duration of an automatically commanded lane change in UN Regulation No. 79, s.
const REGULATION_S: f64 = 5.0;
/// Farthest vehicle that is seen, m.
const SIGHT_M: f64 = 150.0;
/// Widths of lanes that are believed, m.
const LANE_WIDTHS_M: (f64, f64) = (2.8, 4.5);
/// Where the ego begins on its road, m.
const BEGIN_M: f64 = 500.0;

/// Cost weights of the Frenet planner: squared jerk, duration, lateral offset and deviation of speed, all squared but the duration
/// (the values of the widely used implementation in PythonRobotics).
const FRENET_WEIGHTS: [f64; 4] = [0.1, 0.1, 1.0, 1.0];
/// Time between two looks of its collision check, s.
const FRENET_STEP_S: f64 = 0.1;
/// Bumper gap and distance across the road below which it sees a collision, m.
const FRENET_GAP_M: (f64, f64) = (2.0, 2.0);

/// The names of the planners, in the order of the table.
const NAMES: [&str; 5] =
    ["ours, preset's weights", "ours, learned", "ours, learned, all features, three ends", "Frenet", "least jerk"];

/// Why a planner has no path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
enum Cause {
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// Of a planner that looks at its paths one by one.
    #[error("every path within the bounds comes too near to a vehicle")]
    NoFreePath,
}

/// A driver's moment.
struct Moment {
    scene: Scene,
    forecast: Forecast,
    side: Side,
}

/// Compares them on `demonstrations`.
///
/// # Errors
/// If a reward cannot be learned, or a setting is out of range.
pub fn planners(
    demonstrations: &Demonstrations,
    candidates: &CandidateConfig,
    irl: &IrlConfig,
    preset: &PlannerConfig,
) -> Result<StudyReport, PlannersError> {
    let planner_config = PlannerConfig {
        duration_max_s: candidates.duration_max_s,
        duration_max_extended_s: candidates.duration_max_s,
        ..preset.clone()
    };
    let paper = Choices::new(demonstrations, candidates);
    let wide = Choices::new(demonstrations, &candidates.clone().wide());
    let mut found = Vec::new();
    for group in paper.groups() {
        let configs = [
            planner_config.clone(),
            learned(&paper, group, irl, &planner_config)?,
            PlannerConfig {
                end_offsets_m: wide.config.end_offsets_m.clone(),
                end_speed_changes_mps: wide.config.end_speed_changes_mps.clone(),
                ..learned(&wide, group, irl, &planner_config)?
            },
        ];
        let mut ours = Vec::new();
        for config in &configs {
            ours.push(Planner::new(config, &VehicleParams::default())?);
        }
        let members = demonstrations.items.iter().zip(&paper.items).filter(|(item, _)| item.group == group);
        for (item, choice) in members {
            let moment = Moment::new(item)?;
            let grid = sampled(&moment, &wide.config);
            let by = |planner: &Planner| moment.ask(planner);
            let [frenet, jerk] = [frenet_cost, jerk_cost].map(|cost| cheapest(&moment, &grid, cost));
            found.push((choice, [by(&ours[0]), by(&ours[1]), by(&ours[2]), frenet, jerk]));
        }
    }
    report(&found)
}

/// Our planner with the reward of all groups but one.
fn learned(
    choices: &Choices,
    group: &str,
    irl: &IrlConfig,
    config: &PlannerConfig,
) -> Result<PlannerConfig, PlannersError> {
    let (model, ..) = learn(&choices.filtered(|item| item.group != group), irl)?;
    Ok(config.clone().with_reward(&model))
}

impl Moment {
    /// The begin of `item`, on a straight road of the two lanes.
    fn new(item: &Demonstration) -> Result<Self, ConfigError> {
        let width_m = (item.target_d_m - item.start_d_m).abs().clamp(LANE_WIDTHS_M.0, LANE_WIDTHS_M.1);
        let left = item.target_d_m > item.start_d_m;
        let (side, from, to) = if left { (Side::Left, 0, 1) } else { (Side::Right, 1, 0) };
        let config = RoadConfig {
            lanes: 2,
            lane_width_m: width_m,
            length_m: 2000.0,
            topology: Topology::Open,
            curvature: Vec::new(),
            ..RoadConfig::default()
        };
        let road = Arc::new(Road::new(config)?);
        let shift_m = road.lane_center_m(LaneIndex(to)) - item.target_d_m;
        let at = |time_s: f64| item.ego.state(time_s);
        let ego = at(item.start_s);
        let mut neighbors: Vec<Neighbor> = Vec::new();
        for other in item.others.iter().filter(|other| other.covers(item.start_s)) {
            let point = other.state(item.start_s);
            let (d_m, ahead_m) = (point.d_m + shift_m, point.s_m - ego.s_m);
            // Beyond the two lanes nobody matters; half a lane of slack, because lanes are not parallel.
            if !(-0.5 * width_m..1.5 * width_m).contains(&d_m) || ahead_m.abs() > SIGHT_M {
                continue;
            }
            let lane = road.nearest_lane(d_m);
            let car = Neighbor::car(VehicleId(other.vehicle_id), lane, d_m, ahead_m, point.speed_mps.max(0.0));
            neighbors.push(Neighbor { length_m: other.length_m, width_m: other.width_m, ..car });
        }
        neighbors.sort_by(|a, b| a.ahead_m.total_cmp(&b.ahead_m).then(a.id.cmp(&b.id)));
        let ego_state = VehicleState {
            s_m: BEGIN_M,
            d_m: item.start_d_m + shift_m,
            speed_mps: ego.speed_mps,
            ..VehicleState::default()
        };
        let scene = Scene {
            road,
            ego: ego_state,
            ego_length_m: item.ego.length_m,
            ego_width_m: item.ego.width_m,
            ego_lane: LaneIndex(from),
            neighbors,
        };
        let mut forecast = Forecast::default();
        Predictor::ConstantVelocity.forecast(&scene, &mut forecast);
        Ok(Self { scene, forecast, side })
    }

    fn ask(&self, planner: &Planner) -> Result<Motion, Cause> {
        let window = planner.window(&self.scene, &self.forecast, self.side)?;
        let path = planner.choose(&self.scene, &self.forecast, &window);
        let speed_mps = self.scene.ego.road_speed_mps();
        Ok(Motion { lateral: path.quintic, speed_mps, speed_change_mps: path.speed_change_mps })
    }

    /// Whether `motion` touches nobody of the forecast.
    fn is_free(&self, motion: &Motion) -> bool {
        let course = motion.course();
        let steps = (motion.lateral.duration_s / FRENET_STEP_S).ceil() as u32;
        (0..=steps).all(|step| {
            let time_s = f64::from(step) * FRENET_STEP_S;
            let (way_m, d_m) = (course.at(time_s).0, motion.lateral.at(time_s).0);
            self.scene.neighbors.iter().enumerate().all(|(index, neighbor)| {
                let point = self.forecast.at(index, time_s);
                let lengths_m = 0.5 * (neighbor.length_m + self.scene.ego_length_m);
                (point.ahead_m - way_m).abs() - lengths_m >= FRENET_GAP_M.0 || (point.d_m - d_m).abs() >= FRENET_GAP_M.1
            })
        })
    }
}

/// Durations, lateral ends and speeds of the sampling planners.
fn sampled(moment: &Moment, config: &CandidateConfig) -> Vec<Motion> {
    let scene = &moment.scene;
    let to = if moment.side == Side::Left { LaneIndex(1) } else { LaneIndex(0) };
    let start = lanecraft_drive::plan::LateralState { d_m: scene.ego.d_m, ..Default::default() };
    let (end_m, speed_mps) = (scene.road.lane_center_m(to), scene.ego.road_speed_mps());
    config.motions(start, end_m, speed_mps)
}

/// The free motion of least cost within 4 m/s² across and 3 m/s² along the road; the first of equals.
fn cheapest(moment: &Moment, motions: &[Motion], cost: fn(&Moment, &Motion) -> f64) -> Result<Motion, Cause> {
    let comfortable =
        |motion: &&Motion| motion.lateral.max_accel_mps2() <= 4.0 && motion.course().max_accel_mps2() <= 3.0;
    let mut comfortable = motions.iter().filter(comfortable).peekable();
    let cause = if comfortable.peek().is_some() { Cause::NoFreePath } else { Refusal::LateralLimit.into() };
    let free = comfortable.filter(|motion| moment.is_free(motion));
    free.map(|motion| (cost(moment, motion), motion))
        .reduce(|best, other| if other.0 < best.0 { other } else { best })
        .map(|(_, motion)| *motion)
        .ok_or(cause)
}

fn frenet_cost(moment: &Moment, motion: &Motion) -> f64 {
    let [jerk, time, across, speed] = FRENET_WEIGHTS;
    let duration_s = motion.lateral.duration_s;
    let to = if moment.side == Side::Left { LaneIndex(1) } else { LaneIndex(0) };
    let offset_m = motion.lateral.at(duration_s).0 - moment.scene.road.lane_center_m(to);
    // Duration counts once across and once along the road.
    jerk * squared_jerk(motion)
        + 2.0 * time * duration_s
        + across * offset_m * offset_m
        + speed * motion.speed_change_mps * motion.speed_change_mps
}

fn jerk_cost(_: &Moment, motion: &Motion) -> f64 {
    squared_jerk(motion)
}

/// ∫ of the squared jerk along and across the road over the duration, m²/s⁵, in closed form.
fn squared_jerk(motion: &Motion) -> f64 {
    let [_, _, _, c3, c4, c5] = motion.lateral.coefficients;
    let t = motion.lateral.duration_s;
    let across = t
        * (36.0 * c3 * c3
            + t * (144.0 * c3 * c4
                + t * (192.0 * c4 * c4 + 240.0 * c3 * c5 + t * (720.0 * c4 * c5 + t * 720.0 * c5 * c5))));
    // Of Δ/t² · (6 − 12 x).
    let change = motion.speed_change_mps;
    across + 12.0 * change * change / (t * t * t)
}

/// What a planner did on the scenes that all accept, one value each.
struct Figures {
    end_point_m: Vec<f64>,
    duration_error_s: Vec<f64>,
    durations_s: Vec<f64>,
    peak_mps2: Vec<f64>,
    jerk_mps3: Vec<f64>,
}

impl Figures {
    fn new(chosen: &[(&Choice, Motion)]) -> Self {
        let each =
            |of: &dyn Fn(&Choice, &Motion) -> f64| chosen.iter().map(|(choice, motion)| of(choice, motion)).collect();
        Self {
            end_point_m: each(&|choice, motion| {
                let end_s = choice.driver.lateral.duration_s;
                // Across the road from the begin of each, because scenes have their own origin.
                let moved = |lateral: &Quintic| lateral.at(end_s).0 - lateral.at(0.0).0;
                let across_m = moved(&motion.lateral) - moved(&choice.driver.lateral);
                libm::hypot(motion.course().at(end_s).0 - choice.driver_end_m.0, across_m)
            }),
            duration_error_s: each(&|choice, motion| {
                (motion.lateral.duration_s - choice.driver.lateral.duration_s).abs()
            }),
            durations_s: each(&|_, motion| motion.lateral.duration_s),
            peak_mps2: each(&|_, motion| motion.lateral.max_accel_mps2()),
            jerk_mps3: each(&|_, motion| (squared_jerk(motion) / motion.lateral.duration_s).sqrt()),
        }
    }

    fn row(&self, name: &str, refused: String) -> Result<Vec<String>, PlannersError> {
        let cell = |values: &[f64]| {
            let Interval { mean, low, high } = mean_interval(values).map_err(|_| PlannersError::NothingInCommon)?;
            Ok::<_, PlannersError>(format!("{mean:.2} ({low:.2} to {high:.2})"))
        };
        let quick = self.durations_s.iter().filter(|duration_s| **duration_s < REGULATION_S).count();
        Ok(vec![
            name.to_owned(),
            cell(&self.end_point_m)?,
            cell(&self.duration_error_s)?,
            cell(&self.durations_s)?,
            format!("{:.0}", 100.0 * quick as f64 / self.durations_s.len() as f64),
            cell(&self.peak_mps2)?,
            cell(&self.jerk_mps3)?,
            refused,
        ])
    }
}

/// What each planner did at each moment, by the order of [`NAMES`].
type Found<'a> = [(&'a Choice, [Result<Motion, Cause>; NAMES.len()])];

fn report(found: &Found) -> Result<StudyReport, PlannersError> {
    let common: Vec<_> = found.iter().filter(|(_, motions)| motions.iter().all(Result::is_ok)).collect();
    let caption =
        format!("On the {} of {} lane changes that all planners accept; refusals on all", common.len(), found.len());
    let head = [
        "planner",
        "distance from the driver when the driver's change ended, m",
        "error of t_c, s",
        "t_c, s",
        "below 5 s, %",
        "peak lateral acceleration, m/s²",
        "jerk rms, m/s³",
        "refused",
    ];
    let mut table = Table::new("planners", &caption, &head);
    for (index, name) in NAMES.iter().enumerate() {
        let chosen: Vec<(&Choice, Motion)> =
            common.iter().filter_map(|(choice, motions)| Some((*choice, motions[index].ok()?))).collect();
        let refused = found.iter().filter(|(_, motions)| motions[index].is_err()).count();
        table.rows.push(Figures::new(&chosen).row(name, refused.to_string())?);
    }
    let drivers: Vec<(&Choice, Motion)> = common.iter().map(|(choice, _)| (*choice, choice.driver)).collect();
    table.rows.push(Figures::new(&drivers).row("the drivers, as quintics", "0".to_owned())?);
    let summary = "Every planner is asked when the driver began, with a reward learned from the other groups where one is learned. A refusal \
         contradicts a person who did change lanes then, who saw more than positions and speeds. UN Regulation No. 79 wants an \
         automatically commanded lane change done in less than 5 s."
        .to_owned();
    Ok(StudyReport {
        name: "planners",
        title: "Planners beside people".into(),
        summary,
        tables: vec![table, refusals(found)],
        figures: Vec::new(),
    })
}

/// How often each planner refused for each cause; causes of no refusal are left out.
fn refusals(found: &Found) -> Table {
    let head: Vec<&str> = ["cause"].into_iter().chain(NAMES).collect();
    let mut table = Table::new("refusals", &format!("Refusals by cause, of {} lane changes", found.len()), &head);
    for cause in Refusal::ALL.map(Cause::Refused).into_iter().chain([Cause::NoFreePath]) {
        let count = |index: usize| found.iter().filter(|(_, motions)| motions[index] == Err(cause)).count();
        let counts: [usize; NAMES.len()] = std::array::from_fn(count);
        if counts.iter().any(|&count| count > 0) {
            table.rows.push([cause.to_string()].into_iter().chain(counts.map(|count| count.to_string())).collect());
        }
    }
    table
}

#[cfg(test)]
mod tests {
    use lanecraft_drive::plan::LateralState;

    use super::*;
    use crate::demonstrations::synthetic::{SyntheticConfig, synthetic};

    #[test]
    fn the_squared_jerk_is_that_of_samples() {
        let lateral = Quintic::new(LateralState { d_m: 0.3, speed_mps: 0.4, accel_mps2: -0.2 }, 3.75, 3.0);
        let motion = Motion { lateral, speed_mps: 25.0, speed_change_mps: -2.0 };
        let (samples, mut sum) = (30_000, 0.0);
        for k in 0..samples {
            let time_s = 3.0 * (f64::from(k) + 0.5) / f64::from(samples);
            let (across, along) = (motion.lateral.at(time_s).3, motion.course().at(time_s).2);
            sum += (across * across + along * along) * 3.0 / f64::from(samples);
        }
        assert!((squared_jerk(&motion) / sum - 1.0).abs() < 1e-6);
    }

    #[test]
    fn planners_meet_drivers_and_the_one_of_least_jerk_takes_longest() {
        let candidates = CandidateConfig { duration_max_s: 6.0, duration_step_s: 0.5, ..CandidateConfig::default() };
        let drivers = synthetic(&SyntheticConfig::default(), &candidates, 3, 16);
        let preset = PlannerConfig { duration_step_s: 0.5, ..PlannerConfig::default() };
        let report = planners(&drivers, &candidates, &IrlConfig::default(), &preset).unwrap();
        let [table, refusals] = &report.tables[..] else { panic!("two tables") };
        assert_eq!(table.rows.len(), NAMES.len() + 1);
        let number = |row: usize, column: usize| {
            table.rows[row][column].split(' ').next().and_then(|text| text.parse::<f64>().ok()).unwrap()
        };
        // What was learned from such drivers is nearer to them than what takes its time.
        assert!(number(1, 2) < number(4, 2), "{}", table.text());
        assert!((0..4).all(|row| number(row, 3) < number(4, 3) + 1e-9), "{}", table.text());
        assert!((0..4).all(|row| number(row, 6) > number(4, 6) - 1e-9), "{}", table.text());
        assert_eq!(number(5, 1), 0.0_f64.max(number(5, 1)).min(0.5));
        // Every refusal has its cause.
        for (index, row) in table.rows[..NAMES.len()].iter().enumerate() {
            let causes = refusals.rows.iter().map(|row| row[index + 1].parse::<usize>().unwrap()).sum::<usize>();
            assert_eq!(row[7], causes.to_string(), "{}", refusals.text());
        }
    }
}
