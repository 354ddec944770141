//! The fundamental diagram of the human drivers: flow, speed and lane changes over density, beside SUMO and a recorded freeway.
//!
//! A ring has one density, so its mean speed over time and vehicles is the speed of Edie's definition over the whole ring, and the
//! flow is their product (Edie, 1963). SUMO drives the same ring with drivers from the same ranges. The recording is NGSIM's US-101
//! (US Department of Transportation, 2005) in regions of a lane and 5 s. Both come from `bench/peers/fundamental_diagram.py`.

use lanecraft_drive::road::RoadConfig;
use lanecraft_drive::scenario::{ScenarioDistribution, TrafficConfig};
use lanecraft_drive::traffic::World;

use super::in_parallel;
use super::output::{Figure, StudyError, StudyReport, Table};
use crate::report::svg::{Axis, Plot, stack};

const DENSITIES_VEH_PER_KM_LANE: [f64; 9] = [6.0, 10.0, 14.0, 20.0, 26.0, 34.0, 44.0, 60.0, 80.0];
const SEEDS: u64 = 4;
const STEP_S: f64 = 0.1;
/// Until then the traffic spreads, s.
const SETTLE_S: f64 = 120.0;
const WATCHED_S: f64 = 480.0;
/// Lane changes in the recording, with the lane held for a second before and after, and the way driven, km.
const RECORDED_CHANGES: f64 = 29.0;
const RECORDED_WAY_KM: f64 = 61.1;
/// Densities of the recording, in classes of this width, are compared with ours, per kilometer and lane.
const CLASS_VEH_PER_KM_LANE: f64 = 10.0;
/// A class with fewer regions says little.
const FEWEST_REGIONS: usize = 5;

/// The recording's place among the series, gray.
const RECORDED_SERIES: usize = 6;

/// A state of the traffic.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct State {
    density_veh_per_km_lane: f64,
    speed_mps: f64,
    /// Lane changes per kilometer that a vehicle drives.
    changes_per_veh_km: f64,
}

impl State {
    fn flow_veh_per_h_lane(self) -> f64 {
        3.6 * self.density_veh_per_km_lane * self.speed_mps
    }

    /// Mean of states of one density.
    fn mean(states: &[Self]) -> Self {
        let mean = |value: fn(&Self) -> f64| states.iter().map(value).sum::<f64>() / states.len() as f64;
        Self {
            density_veh_per_km_lane: mean(|state| state.density_veh_per_km_lane),
            speed_mps: mean(|state| state.speed_mps),
            changes_per_veh_km: mean(|state| state.changes_per_veh_km),
        }
    }
}

pub(super) fn run() -> Result<StudyReport, StudyError> {
    let cases: Vec<(f64, u64)> =
        DENSITIES_VEH_PER_KM_LANE.iter().flat_map(|&density| (0..SEEDS).map(move |seed| (density, seed))).collect();
    let states = in_parallel(&cases, |&(density, seed)| drive(density, seed))?;
    let ours: Vec<State> = states.chunks(SEEDS as usize).map(State::mean).collect();
    let series = [
        ("ours", ours.clone()),
        ("SUMO, LC2013", sumo("sumo-lc2013")),
        ("SUMO, LC2013, keeping right", sumo("sumo-lc2013-keep-right")),
    ];
    let recorded = recording();
    Ok(StudyReport {
        name: "fundamental-diagram",
        title: "Flow, speed and lane changes over density".into(),
        summary: summary(&series, &recorded),
        tables: vec![points(&series), classes(&recorded, &ours)],
        figures: vec![figure(&series, &recorded)],
    })
}

/// The default preset's ring and drivers at a density.
fn drive(density_veh_per_km_lane: f64, seed: u64) -> Result<State, StudyError> {
    let traffic = TrafficConfig { density_veh_per_km_lane, ..TrafficConfig::default() };
    let scenario = ScenarioDistribution { road: RoadConfig::default(), traffic }.sample(seed)?;
    let mut world = World::new(&scenario)?;
    for _ in 0..(SETTLE_S / STEP_S).round() as u32 {
        let _ = world.step_alone(STEP_S);
    }
    let steps = (WATCHED_S / STEP_S).round() as u32;
    let (mut way_m, mut changes) = (0.0, 0);
    for _ in 0..steps {
        changes += world.step_alone(STEP_S).lane_changes;
        way_m += STEP_S * world.vehicles().map(|vehicle| vehicle.speed_mps).sum::<f64>();
    }
    let road = world.road().config();
    Ok(State {
        density_veh_per_km_lane: 1000.0 * world.len() as f64 / (road.length_m * f64::from(road.lanes)),
        speed_mps: way_m / (WATCHED_S * world.len() as f64),
        changes_per_veh_km: 1000.0 * f64::from(changes) / way_m,
    })
}

/// The fields of each line but the first.
fn rows(text: &'static str) -> impl Iterator<Item = Vec<&'static str>> {
    text.lines().skip(1).map(|line| line.split(',').collect())
}

fn number(text: &str) -> f64 {
    text.parse().expect("the scripts write numbers")
}

fn sumo(name: &str) -> Vec<State> {
    rows(include_str!("data/sumo.csv"))
        .filter(|row| row[0] == name)
        .map(|row| State {
            density_veh_per_km_lane: number(row[1]),
            speed_mps: number(row[2]),
            changes_per_veh_km: number(row[3]),
        })
        .collect()
}

/// The regions of the recording; their changes are counted together only.
fn recording() -> Vec<State> {
    rows(include_str!("data/us101.csv"))
        .map(|row| State {
            density_veh_per_km_lane: number(row[3]),
            speed_mps: number(row[4]),
            changes_per_veh_km: f64::NAN,
        })
        .collect()
}

fn points(series: &[(&str, Vec<State>)]) -> Table {
    let head = ["series", "density veh/km/lane", "flow veh/h/lane", "speed m/s", "lane changes per veh km"];
    let mut table = Table::new("points", "Rings of 1 km, 3 lanes, IDM, 8 minutes after 2", &head);
    for (name, states) in series {
        table.rows.extend(states.iter().map(|state| {
            vec![
                (*name).to_owned(),
                format!("{:.0}", state.density_veh_per_km_lane),
                format!("{:.0}", state.flow_veh_per_h_lane()),
                format!("{:.2}", state.speed_mps),
                format!("{:.3}", state.changes_per_veh_km),
            ]
        }));
    }
    table
}

/// Between two of `states` by linear interpolation, (flow, speed).
fn at_density(states: &[State], density_veh_per_km_lane: f64) -> Option<(f64, f64)> {
    let pair = states.windows(2).find(|pair| {
        (pair[0].density_veh_per_km_lane..=pair[1].density_veh_per_km_lane).contains(&density_veh_per_km_lane)
    })?;
    let [low, high] = [pair[0], pair[1]];
    let share = (density_veh_per_km_lane - low.density_veh_per_km_lane)
        / (high.density_veh_per_km_lane - low.density_veh_per_km_lane);
    let speed_mps = low.speed_mps + share * (high.speed_mps - low.speed_mps);
    Some((3.6 * density_veh_per_km_lane * speed_mps, speed_mps))
}

/// Classes of density of the recording: mean state and number of regions.
fn in_classes(recorded: &[State]) -> Vec<(State, usize)> {
    let class = |state: &State| (state.density_veh_per_km_lane / CLASS_VEH_PER_KM_LANE) as usize;
    (0..=recorded.iter().map(class).max().unwrap_or(0))
        .map(|wanted| recorded.iter().copied().filter(|state| class(state) == wanted).collect::<Vec<_>>())
        .filter(|states| states.len() >= FEWEST_REGIONS)
        .map(|states| (State::mean(&states), states.len()))
        .collect()
}

fn classes(recorded: &[State], ours: &[State]) -> Table {
    let head =
        ["density veh/km/lane", "regions", "flow veh/h/lane", "ours", "speed m/s", "ours", "speed, ours over recorded"];
    let mut table = Table::new("recording", "US-101 by classes of density, and ours at the mean density", &head);
    for (state, regions) in in_classes(recorded) {
        if let Some((flow, speed_mps)) = at_density(ours, state.density_veh_per_km_lane) {
            table.rows.push(vec![
                format!("{:.1}", state.density_veh_per_km_lane),
                regions.to_string(),
                format!("{:.0}", state.flow_veh_per_h_lane()),
                format!("{flow:.0}"),
                format!("{:.2}", state.speed_mps),
                format!("{speed_mps:.2}"),
                format!("{:.2}", speed_mps / state.speed_mps),
            ]);
        }
    }
    table
}

/// Three plots over the same axis of density.
fn figure(series: &[(&str, Vec<State>)], recorded: &[State]) -> Figure {
    type Value = fn(State) -> f64;
    let panels: [(&str, Value); 3] = [
        ("flow, vehicles per hour and lane", State::flow_veh_per_h_lane),
        ("speed, m/s", |state| state.speed_mps),
        ("lane changes per vehicle-kilometer", |state| state.changes_per_veh_km),
    ];
    let title = "Flow, speed and lane changes over density".to_owned();
    let plots = panels.map(|(name, value)| {
        let all = series.iter().flat_map(|(_, states)| states).chain(recorded).map(|state| value(*state));
        let densities = Axis::exactly("density, vehicles per kilometer and lane", 0.0, 90.0);
        let mut plot = Plot::new(densities, Axis::over(name, all.chain([0.0])));
        for state in recorded {
            plot.point([state.density_veh_per_km_lane, value(*state)], RECORDED_SERIES);
        }
        // Ours last, so that nothing hides it.
        for (index, (_, states)) in series.iter().enumerate().rev() {
            let line: Vec<[f64; 2]> =
                states.iter().map(|state| [state.density_veh_per_km_lane, value(*state)]).collect();
            plot.line(&line, index);
            for point in line {
                plot.point(point, index);
            }
        }
        plot
    });
    let [flow, speed, mut changes] = plots;
    let all = State::mean(recorded);
    changes.point([all.density_veh_per_km_lane, RECORDED_CHANGES / RECORDED_WAY_KM], RECORDED_SERIES);
    let plots = [flow, speed, changes].map(|plot| plot.finish(&title));
    let mut legend: Vec<(String, usize)> =
        series.iter().enumerate().map(|(index, (name, _))| ((*name).to_owned(), index)).collect();
    legend.push(("US-101, recorded".to_owned(), RECORDED_SERIES));
    Figure { name: "density".into(), svg: stack(&plots, &title), title, legend }
}

/// Largest flow and where, and how far SUMO's speeds are from ours.
fn summary(series: &[(&str, Vec<State>)], recorded: &[State]) -> String {
    let ours = &series[0].1;
    let capacity = |states: &[State]| states.iter().map(|state| state.flow_veh_per_h_lane()).fold(0.0, f64::max);
    let apart = ours.iter().zip(&series[1].1).map(|(ours, sumo)| ours.speed_mps / sumo.speed_mps - 1.0);
    let (low, high) = apart.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    format!(
        "Largest flow: {:.0} vehicles per hour and lane, SUMO's {:.0}. At equal density our speed differs from SUMO's by {:+.1} to \
         {:+.1} %. The recording holds {} regions and {:.2} lane changes per vehicle-kilometer.",
        capacity(ours),
        capacity(&series[1].1),
        100.0 * low,
        100.0 * high,
        recorded.len(),
        RECORDED_CHANGES / RECORDED_WAY_KM
    )
}

#[cfg(test)]
mod tests {
    use super::{DENSITIES_VEH_PER_KM_LANE, at_density, drive, in_classes, recording, sumo};

    #[test]
    fn sumo_drove_the_same_densities() {
        for name in ["sumo-lc2013", "sumo-lc2013-keep-right"] {
            let densities: Vec<f64> = sumo(name).iter().map(|state| state.density_veh_per_km_lane).collect();
            assert_eq!(densities, DENSITIES_VEH_PER_KM_LANE, "{name}");
        }
    }

    #[test]
    fn speeds_are_near_those_of_sumo_and_of_the_recording() {
        let states = [20.0, 34.0, 44.0].map(|density| drive(density, 0).expect("possible"));
        let sumo = sumo("sumo-lc2013");
        for state in states {
            let (_, theirs_mps) = at_density(&sumo, state.density_veh_per_km_lane).expect("in its range");
            // The same drivers' model and ranges; what differs is who drives, and the lane changes.
            assert!((state.speed_mps / theirs_mps - 1.0).abs() < 0.1, "{state:?} against {theirs_mps} m/s");
        }
        for (state, _) in in_classes(&recording()) {
            if let Some((_, speed_mps)) = at_density(&states, state.density_veh_per_km_lane) {
                // The default drivers are not fitted to this road.
                assert!((speed_mps / state.speed_mps - 1.0).abs() < 0.5, "{speed_mps} m/s against {state:?}");
            }
        }
    }
}
