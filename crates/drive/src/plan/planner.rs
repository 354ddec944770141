//! From a scene to a lane-change path.

use serde::{Deserialize, Serialize};

use super::candidates::{LateralLimits, PlannerConfig};
use super::features::{FEATURES, Surroundings, features, features_of_set};
use super::motion::Motion;
use super::quintic::{LateralState, Quintic};
use super::reward::reward;
use super::window::{Refusal, TimeLimits, Window, keeps_gaps, share_of_shift};
use crate::config::ConfigError;
use crate::predict::{Forecast, ForecastPoint};
use crate::road::{LaneIndex, Side};
use crate::scene::{Neighbor, Scene};
use crate::vehicle::VehicleParams;

/// Points at which the road's curvature ahead is looked up.
const CURVATURE_POINTS: u32 = 8;

/// A planned lane change.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LaneChangePath {
    /// Which side.
    pub side: Side,
    /// The lane it leaves.
    pub from: LaneIndex,
    /// The lane it enters.
    pub to: LaneIndex,
    /// Lateral position over time.
    pub quintic: Quintic,
    /// By how much the speed at its end is to be higher, m/s.
    pub speed_change_mps: f64,
    /// H of Eq. 18, of the paper's features and those that have a weight.
    pub features: [f64; FEATURES],
    /// r = ϖᵀH on normalized features (Eq. 20).
    pub reward: f64,
}

/// Plans lane changes; holds only parameters.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Planner {
    config: PlannerConfig,
    vehicle: VehicleParams,
}

impl Planner {
    /// A planner for this car.
    ///
    /// # Errors
    /// If a value of either is out of range.
    pub fn new(config: &PlannerConfig, vehicle: &VehicleParams) -> Result<Self, ConfigError> {
        config.validate()?;
        vehicle.validate()?;
        Ok(Self { config: config.clone(), vehicle: vehicle.clone() })
    }

    /// The parameters.
    pub fn config(&self) -> &PlannerConfig {
        &self.config
    }

    /// The allowed durations of a lane change to `side`: the question behind the action mask.
    ///
    /// # Errors
    /// Why the change is not allowed.
    pub fn window(&self, scene: &Scene, forecast: &Forecast, side: Side) -> Result<Window, Refusal> {
        let config = &self.config;
        let (from, start) = (scene.ego_lane, measured_start(scene));
        let to = scene.beside(from, side).ok_or(Refusal::NoLane)?;
        // Out of a lane that ends there is one way, and into one that ends there is none.
        if scene.way_out().map_or(scene.lane_end_ahead_m(to).is_finite(), |out| out != side) {
            return Err(Refusal::LaneEnds);
        }
        let abreast = |n: &Neighbor| n.occupies(to) && n.gap_m(scene.ego_length_m) < 0.0;
        if config.veto && scene.neighbors.iter().any(abreast) {
            return Err(Refusal::Occupied);
        }
        let end_m = scene.road.lane_center_m(to);
        let shortest_s = self.shortest_s(scene, start, end_m).ok_or(Refusal::LateralLimit)?;
        let allowed_s = shortest_s.max(config.duration_max_s);
        let share = self.separation_share(scene, start, end_m);
        let limits = TimeLimits::new(config, (scene, forecast), to, share, allowed_s);
        let (cause, limit_s) = if config.veto { limits.tightest() } else { (Refusal::EmptyWindow, f64::INFINITY) };
        let longest_s = self.steps_s((limit_s.min(allowed_s) / config.duration_step_s + 1e-9).floor());
        if longest_s < shortest_s {
            let alone = limit_s < config.duration_min_s;
            return Err(if alone { cause } else { Refusal::EmptyWindow });
        }
        Ok(Window { side, from, to, start, shortest_s, longest_s })
    }

    /// All paths of `window` within the bounds: by the configured changes of speed, then by rising duration, then by the configured
    /// lateral ends; at least one.
    pub fn candidates(&self, scene: &Scene, forecast: &Forecast, window: &Window) -> Vec<LaneChangePath> {
        let motions = self.motions(scene, forecast, window);
        let mut vectors = vec![[0.0; FEATURES]; motions.len()];
        let half_length_m = |n: &Neighbor| 0.5 * (n.length_m + scene.ego_length_m);
        let half_lengths_m: Vec<f64> = scene.neighbors.iter().map(half_length_m).collect();
        let at = |neighbor: usize, time_s: f64| forecast.at(neighbor, time_s);
        let others = Surroundings { half_lengths_m: &half_lengths_m, at };
        features_of_set(&self.config.features, &self.config.selection(), &motions, &others, &mut vectors);
        let path = |(motion, features)| self.path((window.side, window.from, window.to), &motion, features);
        motions.into_iter().zip(vectors).map(path).collect()
    }

    /// The motions of [`Self::candidates`].
    fn motions(&self, scene: &Scene, forecast: &Forecast, window: &Window) -> Vec<Motion> {
        let allowed = self.bounds(scene);
        let (end_m, speed_mps) = (scene.road.lane_center_m(window.to), scene.ego.road_speed_mps());
        let share = self.separation_share(scene, window.start, end_m);
        let mut motions = Vec::new();
        for &speed_change_mps in &self.config.end_speed_changes_mps {
            for step in self.steps(window.shortest_s)..=self.steps(window.longest_s) {
                for offset_m in &self.config.end_offsets_m {
                    let lateral = Quintic::new(window.start, end_m + offset_m, self.steps_s(f64::from(step)));
                    let motion = Motion { lateral, speed_mps, speed_change_mps };
                    // The first one is the path that the window promises.
                    let free = || {
                        let gaps = || keeps_gaps(&self.config, (scene, forecast), window.to, share, &motion);
                        allowed(&motion) && (speed_change_mps == 0.0 || gaps())
                    };
                    if motions.is_empty() || free() {
                        motions.push(motion);
                    }
                }
            }
        }
        motions
    }

    /// The candidate with the highest reward; the first of equal ones, which of equal ends is the shortest.
    pub fn choose(&self, scene: &Scene, forecast: &Forecast, window: &Window) -> LaneChangePath {
        let mut candidates = self.candidates(scene, forecast, window).into_iter();
        let first = candidates.next().expect("the shortest duration of a window is always a candidate");
        candidates.fold(first, |best, path| if path.reward > best.reward { path } else { best })
    }

    /// The way back to the lane that `path` left, from the measured state: the shortest one within the lateral bounds. None once
    /// the car has come near the marking, or if no duration keeps the bounds.
    ///
    /// The acceleration `elapsed_s` after the start is taken from `path`, so that the reference has no jump. Whether the old lane
    /// is still free is for the caller to judge; the features are those of an empty road.
    pub fn abort(&self, scene: &Scene, path: &LaneChangePath, elapsed_s: f64) -> Option<LaneChangePath> {
        let home_m = scene.road.lane_center_m(path.from);
        if (scene.ego.d_m - home_m).abs() >= self.config.abort_offset_m {
            return None;
        }
        let start = LateralState { accel_mps2: path.quintic.at(elapsed_s).2, ..measured_start(scene) };
        let duration_s = self.shortest_s(scene, start, home_m)?;
        let quintic = Quintic::new(start, home_m, duration_s);
        let motion = held(scene, quintic);
        let nobody = Surroundings { half_lengths_m: &[], at: |_, _| ForecastPoint::default() };
        let vector = features(&self.config.features, &self.config.selection(), &motion, &nobody);
        let side = match path.side {
            Side::Left => Side::Right,
            Side::Right => Side::Left,
        };
        Some(self.path((side, path.to, path.from), &motion, vector))
    }

    /// The path from the measured state to rest at `end_m` that takes `duration_s`, or as little longer as the lateral bounds ask for.
    /// None if no duration keeps them.
    pub fn path_to(&self, scene: &Scene, end_m: f64, duration_s: f64) -> Option<Quintic> {
        let (start, allowed) = (measured_start(scene), self.bounds(scene));
        let paths = (0..)
            .map(|step| duration_s + self.steps_s(f64::from(step)))
            .take_while(|duration_s| *duration_s <= self.config.duration_max_extended_s)
            .map(|duration_s| Quintic::new(start, end_m, duration_s));
        paths.into_iter().find(|path| allowed(&held(scene, *path)))
    }

    fn path(
        &self,
        (side, from, to): (Side, LaneIndex, LaneIndex),
        motion: &Motion,
        features: [f64; FEATURES],
    ) -> LaneChangePath {
        let normalization = (&self.config.feature_means, &self.config.feature_scales);
        let reward = -reward(&self.config.cost_weights, normalization, &features);
        let Motion { lateral, speed_change_mps, .. } = *motion;
        LaneChangePath { side, from, to, quintic: lateral, speed_change_mps, features, reward }
    }

    /// The share of the duration after which a change to `end_m` has left the vehicles of the old lane.
    fn separation_share(&self, scene: &Scene, start: LateralState, end_m: f64) -> f64 {
        let toward = if end_m > start.d_m { 1.0 } else { -1.0 };
        let moved_m = toward * (start.d_m - scene.road.lane_center_m(scene.ego_lane));
        share_of_shift(self.config.clearance_m - moved_m, (end_m - start.d_m).abs())
    }

    /// The shortest duration on the grid within the lateral bounds, s.
    fn shortest_s(&self, scene: &Scene, start: LateralState, end_m: f64) -> Option<f64> {
        let allowed = self.bounds(scene);
        (self.steps(self.config.duration_min_s)..=self.steps(self.config.duration_max_extended_s))
            .map(|step| self.steps_s(f64::from(step)))
            .find(|&duration_s| allowed(&held(scene, Quintic::new(start, end_m, duration_s))))
    }

    /// Whether a motion keeps the bounds at the ego's speed and at that of its end: with the lowest adhesion of the stretch it crosses,
    /// and on the sharpest part of the road within the longest usual change.
    fn bounds<'a>(&'a self, scene: &'a Scene) -> impl Fn(&Motion) -> bool + 'a {
        let speed_mps = scene.ego.road_speed_mps();
        let spacing_m = speed_mps * self.config.duration_max_s / f64::from(CURVATURE_POINTS);
        let sharpest_radpm = (0..=CURVATURE_POINTS)
            .map(|point| scene.road.curvature_radpm(scene.ego.s_m + f64::from(point) * spacing_m).abs())
            .fold(0.0, f64::max);
        move |motion| {
            let end_mps = motion.course().end_speed_mps();
            let way_m = speed_mps.max(end_mps) * motion.lateral.duration_s;
            let adhesion = scene.road.lowest_adhesion(scene.ego.s_m, way_m);
            let keeps = |speed_mps: f64| {
                let curve_accel_mps2 = sharpest_radpm * speed_mps * speed_mps;
                LateralLimits::new(&self.config, &self.vehicle, (speed_mps, adhesion, curve_accel_mps2)).allow(motion)
            };
            keeps(speed_mps) && (end_mps == speed_mps || keeps(end_mps))
        }
    }

    /// A duration on the grid in steps.
    fn steps(&self, duration_s: f64) -> u32 {
        (duration_s / self.config.duration_step_s).round() as u32
    }

    /// A whole number of steps as a duration, s.
    fn steps_s(&self, steps: f64) -> f64 {
        steps * self.config.duration_step_s
    }
}

/// `lateral` at the ego's speed, which it keeps.
fn held(scene: &Scene, lateral: Quintic) -> Motion {
    Motion { lateral, speed_mps: scene.ego.road_speed_mps(), speed_change_mps: 0.0 }
}

/// The ego's lateral state. Its lateral acceleration relative to the road is V_x γ less the road's own V² κ, to first order.
fn measured_start(scene: &Scene) -> LateralState {
    let ego = &scene.ego;
    let curvature_radpm = scene.road.curvature_radpm(ego.s_m);
    LateralState {
        d_m: ego.d_m,
        speed_mps: ego.road_lateral_speed_mps(),
        accel_mps2: ego.speed_mps * (ego.yaw_rate_radps - ego.speed_mps * curvature_radpm),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use lanecraft_net::random::Stream;

    use super::*;
    use crate::plan::{LateralBound, RewardModel};
    use crate::predict::Predictor;
    use crate::predict::tests::{neighbor, scene};
    use crate::road::{AdhesionPatch, Road, RoadConfig, Topology};
    use crate::scene::Neighbor;

    fn planner() -> Planner {
        Planner::new(&PlannerConfig::default(), &VehicleParams::default()).unwrap()
    }

    fn forecast(scene: &Scene) -> Forecast {
        let mut forecast = Forecast::default();
        Predictor::ConstantVelocity.forecast(scene, &mut forecast);
        forecast
    }

    fn window(scene: &Scene, side: Side) -> Result<Window, Refusal> {
        planner().window(scene, &forecast(scene), side)
    }

    #[test]
    fn an_empty_road_allows_all_that_the_car_can_do() {
        for side in Side::BOTH {
            let window = window(&scene(vec![]), side).unwrap();
            // |d̈| = (10/√3) · 3.75 m / t_c² reaches 4 m/s² at 2.33 s.
            assert!((window.shortest_s - 2.4).abs() < 1e-9 && (window.longest_s - 4.0).abs() < 1e-9);
        }
    }

    #[test]
    fn every_refusal_has_its_scene() {
        // The ego drives 25 m/s in the middle lane.
        let left = |neighbors| window(&scene(neighbors), Side::Left).map(|_| ());
        let edge = Scene { ego_lane: LaneIndex(2), ..scene(vec![]) };
        assert_eq!(window(&edge, Side::Left).map(|_| ()), Err(Refusal::NoLane));
        assert_eq!(left(vec![neighbor(3.0, 25.0, 2)]), Err(Refusal::Occupied));
        assert_eq!(left(vec![neighbor(15.0, 20.0, 2)]), Err(Refusal::TargetLeader));
        assert_eq!(left(vec![neighbor(12.0, 20.0, 1)]), Err(Refusal::CurrentLeader));
        assert_eq!(left(vec![neighbor(-20.0, 33.0, 2)]), Err(Refusal::Follower));
        // Time for a change of 1.9 s, but not of 2.4 s.
        assert_eq!(left(vec![neighbor(23.0, 20.0, 2)]), Err(Refusal::EmptyWindow));
        let standing = Scene { ego: crate::vehicle::VehicleState { d_m: 3.75, ..Default::default() }, ..scene(vec![]) };
        assert_eq!(window(&standing, Side::Left).map(|_| ()), Err(Refusal::LateralLimit));
        // Harmless: the follower in the old lane, a leader who pulls away, a car beyond the new lane on the other side.
        let harmless = vec![neighbor(-12.0, 30.0, 1), neighbor(0.5, 25.0, 0), neighbor(20.0, 33.0, 2)];
        assert_eq!(left(harmless), Ok(()));
        // A car that changes into the new lane from beyond is seen.
        let four_lanes = Arc::new(Road::new(RoadConfig { lanes: 4, ..RoadConfig::default() }).unwrap());
        let entering = Neighbor { target_lane: LaneIndex(2), ..neighbor(2.0, 25.0, 3) };
        let crowded = Scene { road: four_lanes, ..scene(vec![entering]) };
        assert_eq!(window(&crowded, Side::Left).map(|_| ()), Err(Refusal::Occupied));
    }

    #[test]
    fn without_a_veto_only_the_lateral_bounds_refuse() {
        let reckless = PlannerConfig { veto: false, ..PlannerConfig::default() };
        let reckless = Planner::new(&reckless, &VehicleParams::default()).unwrap();
        let crowded = scene(vec![neighbor(3.0, 25.0, 2), neighbor(12.0, 20.0, 1), neighbor(-20.0, 33.0, 2)]);
        assert!(reckless.window(&crowded, &forecast(&crowded), Side::Left).is_ok());
        let standing = Scene { ego: crate::vehicle::VehicleState { d_m: 3.75, ..Default::default() }, ..crowded };
        assert_eq!(reckless.window(&standing, &forecast(&standing), Side::Left), Err(Refusal::LateralLimit));
    }

    #[test]
    fn a_hidden_slow_leader_is_found() {
        let fast = Neighbor { target_lane: LaneIndex(0), ..neighbor(14.0, 33.0, 2) };
        let alone = window(&scene(vec![fast]), Side::Left).unwrap().longest_s;
        let with_slow = window(&scene(vec![fast, neighbor(40.0, 10.0, 2)]), Side::Left);
        assert!(with_slow.map_or(0.0, |w| w.longest_s) < alone);
    }

    #[test]
    fn a_wet_road_or_a_curve_asks_for_longer_changes() {
        let on = |config: RoadConfig, bound: LateralBound| {
            let config_of_planner = PlannerConfig { bound, ..PlannerConfig::default() };
            let planner = Planner::new(&config_of_planner, &VehicleParams::default()).unwrap();
            let scene = Scene { road: Arc::new(Road::new(config).unwrap()), ..scene(vec![]) };
            planner.window(&scene, &forecast(&scene), Side::Left).map(|w| w.shortest_s)
        };
        let dry = on(RoadConfig::default(), LateralBound::Acceleration).unwrap();
        let wet = on(RoadConfig { adhesion: 0.4, ..RoadConfig::default() }, LateralBound::Acceleration).unwrap();
        let ice = on(RoadConfig { adhesion: 0.12, ..RoadConfig::default() }, LateralBound::Acceleration).unwrap();
        assert!(dry < wet && wet < 4.0 && ice > 4.0);
        let point = |(s_m, curvature_radpm)| crate::road::CurvaturePoint { s_m, curvature_radpm };
        let curve = RoadConfig { curvature: [(40.0, 0.0), (60.0, 0.008)].map(point).to_vec(), ..RoadConfig::default() };
        assert!(on(curve, LateralBound::Acceleration).is_ok_and(|t| t > dry));
        // Eq. 15 as printed at 25 m/s: 1.7 s dry, 3.6 s wet.
        assert!((on(RoadConfig::default(), LateralBound::CourseAngle).unwrap() - 1.8).abs() < 0.11);
    }

    #[test]
    fn a_path_is_judged_with_the_lowest_adhesion_it_crosses() {
        // At 25 m/s the dry road allows 2.4 s or 60 m, and the patch takes a change within 3.4 s.
        let shortest_s = |s_m: f64| {
            let adhesion_patches = vec![AdhesionPatch { s_m, length_m: 20.0, adhesion: 0.4 }];
            let road = RoadConfig { topology: Topology::Open, adhesion_patches, ..RoadConfig::default() };
            let scene = Scene { road: Arc::new(Road::new(road).unwrap()), ..scene(vec![]) };
            let begin_m = scene.ego.s_m;
            let (planner, window) = (planner(), window(&scene, Side::Left).unwrap());
            for path in planner.candidates(&scene, &forecast(&scene), &window) {
                let crossed = begin_m + 25.0 * path.quintic.duration_s > s_m;
                assert!(path.quintic.max_accel_mps2() <= if crossed { 0.85 * 0.4 * 9.81 } else { 4.0 });
            }
            window.shortest_s
        };
        let begin_m = scene(vec![]).ego.s_m;
        assert!((shortest_s(begin_m + 61.0) - 2.4).abs() < 1e-9, "beyond its end it does not matter");
        assert!((shortest_s(begin_m + 40.0) - shortest_s(begin_m)).abs() < 1e-9);
        assert!(shortest_s(begin_m) > 2.5);
    }

    #[test]
    fn moving_others_closer_never_widens_a_window() {
        let mut stream = Stream::new(4, "window");
        let mut allowed = 0;
        for _ in 0..400 {
            let (ahead_m, behind_m) = (stream.range(6.0, 80.0), stream.range(6.0, 80.0));
            let (v, w) = (stream.range(15.0, 33.0), stream.range(15.0, 33.0));
            let (front_lane, closer_m) = (1 + u8::from(stream.bernoulli(0.5)), stream.range(0.0, 10.0));
            let longest_s = |closer_m: f64| {
                let others = vec![neighbor(closer_m - behind_m, w, 2), neighbor(ahead_m - closer_m, v, front_lane)];
                window(&scene(others), Side::Left).map_or(0.0, |w| w.longest_s)
            };
            let (far_s, near_s) = (longest_s(0.0), longest_s(closer_m.min(ahead_m - 1.0).min(behind_m - 1.0)));
            assert!(near_s <= far_s, "{near_s} > {far_s}");
            allowed += u32::from(far_s > 0.0);
        }
        assert!((50..350).contains(&allowed), "the scenes decide nothing: {allowed} of 400 allowed");
    }

    #[test]
    fn candidates_keep_the_bounds_and_the_gaps() {
        let mut stream = Stream::new(6, "candidates");
        let planner = planner();
        for _ in 0..200 {
            let mut scene = scene(vec![
                neighbor(-stream.range(10.0, 60.0), stream.range(20.0, 33.0), 0),
                neighbor(stream.range(10.0, 80.0), stream.range(15.0, 25.0), 0),
            ]);
            scene.ego.d_m += stream.range(-0.4, 0.4);
            scene.ego.heading_rad = stream.range(-0.01, 0.01);
            scene.ego.yaw_rate_radps = stream.range(-0.02, 0.02);
            let forecast = forecast(&scene);
            let Ok(window) = planner.window(&scene, &forecast, Side::Right) else { continue };
            let candidates = planner.candidates(&scene, &forecast, &window);
            assert_eq!(candidates[0].quintic.duration_s, window.shortest_s);
            for path in &candidates {
                assert!(path.quintic.max_accel_mps2() <= 4.0 && path.quintic.duration_s <= window.longest_s + 1e-9);
                let t = path.quintic.duration_s;
                let leader_m = scene.neighbors[1].ahead_m
                    + (scene.neighbors[1].speed_mps - scene.ego.road_speed_mps()) * t
                    - t * t;
                assert!(leader_m - 4.8 >= 5.0 - 1e-6);
            }
            let best = planner.choose(&scene, &forecast, &window);
            assert!(candidates.iter().all(|path| path.reward <= best.reward));
        }
    }

    #[test]
    fn candidates_end_beside_the_center_and_at_other_speeds_where_gaps_and_bounds_let_them() {
        let config = PlannerConfig {
            end_offsets_m: vec![0.0, -0.3, 0.3],
            end_speed_changes_mps: vec![0.0, -2.0, 2.0],
            ..PlannerConfig::default()
        };
        let planner = Planner::new(&config, &VehicleParams::default()).unwrap();
        let candidates = |neighbors| {
            let scene = scene(neighbors);
            let forecast = forecast(&scene);
            let window = planner.window(&scene, &forecast, Side::Left).unwrap();
            planner.candidates(&scene, &forecast, &window)
        };
        let free = candidates(vec![]);
        let ends = |change: f64| free.iter().filter(|path| path.speed_change_mps == change).count();
        assert!(ends(0.0) > 40 && ends(2.0) > 40 && ends(-2.0) == ends(2.0));
        let at = |path: &LaneChangePath| path.quintic.at(path.quintic.duration_s).0;
        assert!(free.iter().all(|path| (at(path) - 7.5).abs() < 0.3 + 1e-9) && free.iter().any(|path| at(path) > 7.7));
        assert!(free.iter().all(|path| path.quintic.max_accel_mps2() <= 4.0));
        // A leader of the same speed 22 m ahead leaves 1.2 m at the end of 3.5 s, but 2 m/s more would gain 3.5 m on it.
        let behind = candidates(vec![neighbor(22.0, 25.0, 2)]);
        assert!(behind.iter().all(|path| path.speed_change_mps < 2.0 || path.quintic.duration_s < 3.5));
        assert!(behind.iter().any(|path| path.speed_change_mps == -2.0 && path.quintic.duration_s > 3.4));
        // A follower who is a little faster may be run before, but not braked into.
        let before = candidates(vec![neighbor(-13.0, 26.0, 2)]);
        assert!(before.iter().any(|path| path.speed_change_mps == 2.0));
        assert!(before.iter().all(|path| path.speed_change_mps > -2.0));
    }

    #[test]
    fn equal_rewards_are_decided_for_the_shortest() {
        let config = PlannerConfig { cost_weights: [0.0; FEATURES], ..PlannerConfig::default() };
        let planner = Planner::new(&config, &VehicleParams::default()).unwrap();
        let scene = scene(vec![]);
        let window = planner.window(&scene, &forecast(&scene), Side::Left).unwrap();
        let path = planner.choose(&scene, &forecast(&scene), &window);
        assert_eq!(path.quintic.duration_s, window.shortest_s);
    }

    #[test]
    fn the_default_weights_prefer_durations_of_table_iv() {
        for speed_mps in [25.0, 28.0, 30.0] {
            let mut scene = scene(vec![neighbor(60.0, speed_mps - 3.0, 1)]);
            scene.ego.speed_mps = speed_mps;
            let window = window(&scene, Side::Left).unwrap();
            let duration_s = planner().choose(&scene, &forecast(&scene), &window).quintic.duration_s;
            assert!((2.0..=3.0).contains(&duration_s), "{duration_s} s at {speed_mps} m/s");
        }
    }

    #[test]
    fn a_learned_reward_is_used_as_learned() {
        let reward = RewardModel {
            features: ["stability", "follower", "comfort", "travel"].map(String::from).to_vec(),
            definition: super::super::FeatureConfig { lateral_scale_m: 3.5, ..Default::default() },
            mean: vec![0.01, 0.2, 0.03, 0.1],
            scale: vec![0.02, 0.3, 0.04, 0.05],
            weights: vec![-0.5, -1.0, -2.0, -3.0],
            source: "a test".into(),
        };
        let config = PlannerConfig::default().with_reward(&reward);
        let planner = Planner::new(&config, &VehicleParams::default()).unwrap();
        let scene = scene(vec![neighbor(-40.0, 25.0, 2), neighbor(30.0, 22.0, 1)]);
        let window = planner.window(&scene, &forecast(&scene), Side::Left).unwrap();
        assert!(planner.choose(&scene, &forecast(&scene), &window).features[8] > 0.0);
        for path in planner.candidates(&scene, &forecast(&scene), &window) {
            assert!((path.reward - reward.reward(&path.features)).abs() < 1e-12);
        }
    }

    #[test]
    fn a_change_is_broken_off_only_before_the_marking() {
        let planner = planner();
        let mut scene = scene(vec![]);
        let window = planner.window(&scene, &forecast(&scene), Side::Left).unwrap();
        let path = planner.choose(&scene, &forecast(&scene), &window);
        let mut broken_off = 0;
        for step in 0..=24 {
            let elapsed_s = 0.1 * f64::from(step);
            let (d_m, speed_mps, accel_mps2, _) = path.quintic.at(elapsed_s);
            scene.ego.d_m = d_m;
            scene.ego.lateral_speed_mps = speed_mps;
            let Some(back) = planner.abort(&scene, &path, elapsed_s) else {
                assert!(d_m - 3.75 >= 0.9);
                continue;
            };
            broken_off += 1;
            assert!(d_m - 3.75 < 0.9 && back.to == path.from && back.side == Side::Right);
            assert!(back.quintic.duration_s >= 1.5 && back.quintic.max_accel_mps2() <= 4.0);
            let (start_m, start_mps, start_mps2, _) = back.quintic.at(0.0);
            assert!((start_m - d_m).abs() < 1e-12 && (start_mps - speed_mps).abs() < 1e-12);
            assert_eq!(start_mps2, accel_mps2);
            assert!((back.quintic.at(9.0).0 - 3.75).abs() < 1e-9);
        }
        assert!(broken_off > 5);
    }
}
