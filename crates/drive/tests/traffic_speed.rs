//! Vehicle updates per second; run with `cargo test --release -p lanecraft-drive --test traffic_speed -- --ignored --nocapture`.

use std::time::Instant;

use lanecraft_drive::road::RoadConfig;
use lanecraft_drive::scenario::{ScenarioDistribution, TrafficConfig};
use lanecraft_drive::traffic::{ExternalBody, World};

#[test]
#[ignore = "a measurement, meaningful in release only"]
fn vehicle_updates_per_second() {
    for (vehicles, length_m) in [(50.0, 1190.0), (200.0, 4760.0), (1000.0, 23_810.0)] {
        let distribution = ScenarioDistribution {
            road: RoadConfig { length_m, ..RoadConfig::default() },
            traffic: TrafficConfig {
                density_veh_per_km_lane: vehicles / 3.0 / length_m * 1000.0,
                truck_share: 0.1,
                ..TrafficConfig::default()
            },
        };
        let mut world = World::new(&distribution.sample(1).expect("fits")).expect("possible");
        let (s_m, lane, speed_mps) = world.ego_start();
        let mut body = ExternalBody {
            s_m,
            d_m: world.road().lane_center_m(lane),
            heading_rad: 0.0,
            speed_mps,
            accel_mps2: 0.0,
            length_m: 4.8,
            width_m: 1.9,
            target_lane: lane,
        };
        world.set_ego(body);
        let steps = 20_000_000 / world.len();
        let start = Instant::now();
        for _ in 0..steps {
            body.s_m += 0.05 * body.speed_mps;
            let _ = world.step(body, 0.05);
        }
        let updates = (steps * world.len()) as f64 / start.elapsed().as_secs_f64();
        println!("{} vehicles: {:.1} M vehicle updates/s", world.len(), updates / 1e6);
    }
}
