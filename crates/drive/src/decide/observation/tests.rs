use std::sync::Arc;

use proptest::prelude::*;

use super::features::{EGO, SLOT};
use super::*;
use crate::road::{LaneStretch, Road, RoadConfig, Topology};
use crate::scene::{Neighbor, VehicleId};
use crate::vehicle::VehicleState;

const FORMS: [ObservationForm; 3] = [ObservationForm::Features, ObservationForm::Raw, ObservationForm::Grid];

fn scene() -> Scene {
    let neighbor = |id, ahead_m: f64, lane: u8| {
        Neighbor::car(VehicleId(id), LaneIndex(lane), 3.75 * f64::from(lane), ahead_m, 20.0)
    };
    Scene {
        road: Arc::new(Road::new(RoadConfig::default()).expect("valid")),
        ego: VehicleState { speed_mps: 25.0, ..VehicleState::default() },
        ego_length_m: 4.8,
        ego_width_m: 1.9,
        ego_lane: LaneIndex(0),
        neighbors: vec![neighbor(1, -30.0, 1), neighbor(2, 40.0, 0), neighbor(3, 90.0, 0), neighbor(4, 150.0, 1)],
    }
}

fn of_form(form: ObservationForm) -> ObservationConfig {
    ObservationConfig { form, ..ObservationConfig::default() }
}

fn observed(config: &ObservationConfig, scene: &Scene, situation: &Situation) -> Vec<f32> {
    let mut out = vec![f32::NAN; config.size()];
    observe(config, scene, situation, &mut out);
    out
}

/// The values of one channel and lane, from the rear to the front.
fn row<'a>(config: &ObservationConfig, out: &'a [f32], channel: usize, lane: usize) -> &'a [f32] {
    let [_, lanes, cells] = config.shape()[..] else { panic!("a grid has three axes") };
    &out[(channel * lanes + lane) * cells..][..cells]
}

#[test]
fn shapes_bounds_and_sizes_agree() {
    for (form, shape) in FORMS.into_iter().zip([vec![46], vec![21], vec![10, 3, 41]]) {
        let config = of_form(form);
        let (low, high) = config.bounds();
        assert_eq!(config.shape(), shape);
        assert_eq!([shape.iter().product(), low.len(), high.len()], [config.size(); 3]);
        assert!(low.iter().zip(&high).all(|(low, high)| low.is_finite() && high.is_finite() && low < high));
    }
}

#[test]
fn slots_hold_the_nearest_vehicle_within_range() {
    let out = observed(&ObservationConfig::default(), &scene(), &Situation::default());
    let slots: Vec<&[f32]> = out[EGO.len()..].chunks(SLOT.len()).take(SLOTS).collect();
    assert_eq!(slots[0], [1.0, 0.0, 0.0, 0.0], "the left leader is out of range");
    assert_eq!(slots[1], [-0.3, 1.0, -0.5, 1.0], "the left follower is 30 m behind");
    assert_eq!(slots[2], [0.4, 0.0, -0.5, 1.0], "the own leader is 40 m ahead");
    assert_eq!(slots[4], [0.0, 0.0, -1.0, 1.0], "there is no right lane");
}

#[test]
fn vehicles_mark_every_cell_that_they_cover() {
    let config = of_form(ObservationForm::Grid);
    let mut scene = scene();
    // A truck of 16 m from 32 to 48 m: the cells around 30, 35, 40, 45 and 50 m, of which the outer two begin at 32.5 and end at 47.5.
    scene.neighbors[1].length_m = 16.0;
    let out = observed(&config, &scene, &Situation::default());
    let marked = |lane| -> Vec<usize> {
        let cells = row(&config, &out, 0, lane).iter().enumerate();
        cells.filter(|(_, value)| **value == 1.0).map(|(cell, _)| cell).collect()
    };
    assert_eq!(marked(1), [20, 26, 27, 28, 29, 30, 38], "the ego, the truck and the car 90 m ahead in the own lane");
    assert_eq!(marked(0), [14], "the car 30 m behind on the left");
    assert_eq!(row(&config, &out, 1, 1)[28], -0.5, "5 m/s slower");
    assert_eq!(row(&config, &out, 4, 0), [1.0; 41], "there is a left lane");
}

#[test]
fn where_no_lane_is_stands_a_wall() {
    let config = ObservationConfig { lanes_each_side: 2, ..of_form(ObservationForm::Grid) };
    let open = LaneStretch { lane: LaneIndex(1), from_m: -1e6, to_m: 51.0 };
    let road = RoadConfig { topology: Topology::Open, lanes_open: vec![open], ..RoadConfig::default() };
    let scene = Scene { road: Arc::new(Road::new(road).expect("valid")), neighbors: Vec::new(), ..scene() };
    let out = observed(&config, &scene, &Situation::default());
    for right in [3, 4] {
        assert_eq!(row(&config, &out, 0, right), [1.0; 41]);
        assert_eq!(row(&config, &out, 1, right), [-2.5; 41], "it stands");
        assert_eq!(row(&config, &out, 4, right), [0.0; 41]);
    }
    let ends: Vec<f32> = (0..41).map(|cell| if cell > 30 { 1.0 } else { 0.0 }).collect();
    assert_eq!(row(&config, &out, 0, 1), ends, "the lane ends 51 m ahead");
    assert_eq!(row(&config, &out, 4, 0), [1.0; 41], "the lane beyond goes on");
}

#[test]
fn a_car_between_two_lanes_is_in_both() {
    let config = of_form(ObservationForm::Grid);
    let mut scene = scene();
    scene.ego.d_m = 1.5;
    scene.neighbors.clear();
    let out = observed(&config, &scene, &Situation { allowed: [true, false], ..Situation::default() });
    let offsets = [0, 1].map(|lane| f64::from(row(&config, &out, 2, lane)[20]));
    assert!((offsets[0] + 0.6).abs() < 1e-6 && (offsets[1] - 0.4).abs() < 1e-6, "{offsets:?}");
    assert_eq!([0, 1, 2].map(|lane| row(&config, &out, 5, lane)[0]), [1.0, 0.0, 0.0], "only the left may be entered");
}

#[test]
fn the_nearer_of_two_in_a_cell_is_seen() {
    let config = ObservationConfig { cell_length_m: 50.0, ..of_form(ObservationForm::Grid) };
    for (first_m, second_m) in [(40.0, 60.0), (-60.0, -40.0)] {
        let mut scene = scene();
        let car = |id, ahead_m, speed| Neighbor::car(VehicleId(id), LaneIndex(0), 0.0, ahead_m, speed);
        let (first_mps, second_mps) = if first_m > 0.0 { (15.0, 35.0) } else { (35.0, 15.0) };
        scene.neighbors = vec![car(1, first_m, first_mps), car(2, second_m, second_mps)];
        let out = observed(&config, &scene, &Situation::default());
        assert_eq!(row(&config, &out, 1, 1)[if first_m > 0.0 { 3 } else { 1 }], -1.0, "{first_m}");
    }
}

#[test]
fn a_grid_that_cannot_be_is_refused_by_key() {
    for (config, expected) in [
        (ObservationConfig { cell_length_m: f64::NAN, ..ObservationConfig::default() }, "observation.cell_length_m"),
        (ObservationConfig { cell_length_m: 0.5, ..ObservationConfig::default() }, "observation.cell_length_m"),
        (ObservationConfig { lanes_each_side: 8, ..ObservationConfig::default() }, "observation.lanes_each_side"),
    ] {
        assert!(matches!(config.validate(), Err(ConfigError::OutOfRange { key, .. }) if key == expected));
    }
}

prop_compose! {
    /// Any car, on the road or off it, at any speed.
    fn any_neighbor()(
        id in 0..99_u32, lane in 0..8_u8, ahead_m in -320.0..320.0_f64, d_m in -300.0..300.0_f64,
        speeds_mps in (0.0..500.0_f64, -300.0..300.0_f64), size_m in (0.5..40.0_f64, 0.5..5.0_f64),
    ) -> Neighbor {
        Neighbor {
            lateral_speed_mps: speeds_mps.1,
            length_m: size_m.0,
            width_m: size_m.1,
            ..Neighbor::car(VehicleId(id), LaneIndex(lane), d_m, ahead_m, speeds_mps.0)
        }
    }
}

prop_compose! {
    /// Any scene on any number of lanes, extreme ones included.
    fn any_scene()(
        lanes in 1..=8_u8, place in (-1e6..1e6_f64, -300.0..300.0_f64), heading_rad in -3.2..3.2_f64,
        speed_mps in 0.0..500.0_f64, accel_mps2 in -200.0..200.0_f64,
        mut neighbors in prop::collection::vec(any_neighbor(), 0..150),
    ) -> Scene {
        let road = Road::new(RoadConfig { lanes, ..RoadConfig::default() }).expect("valid");
        neighbors.sort_by(|a, b| a.ahead_m.total_cmp(&b.ahead_m));
        let (s_m, d_m) = place;
        let ego = VehicleState { s_m, d_m, heading_rad, speed_mps, accel_mps2, ..VehicleState::default() };
        Scene { ego_lane: road.nearest_lane(d_m), road: Arc::new(road), ego, neighbors, ..scene() }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(100) })]

    #[test]
    fn every_value_is_within_its_bounds(
        scene in any_scene(), progress in 0.0..9.0_f64, since_change_s in 0.0..1e9_f64, driven_m in -1e9..1e9_f64,
        lanes_each_side in 0..=7_u8, cell_length_m in 1.0..50.0_f64, range_m in 10.0..200.0_f64,
    ) {
        let situation = Situation { progress, since_change_s, driven_m, allowed: [true, false] };
        for form in FORMS {
            let config = ObservationConfig { form, range_m, cell_length_m, lanes_each_side };
            config.validate().expect("drawn within the ranges");
            let (low, high) = config.bounds();
            let out = observed(&config, &scene, &situation);
            for (place, value) in out.iter().enumerate() {
                prop_assert!((low[place]..=high[place]).contains(value), "{form:?}, place {place}: {value}");
            }
        }
    }
}
