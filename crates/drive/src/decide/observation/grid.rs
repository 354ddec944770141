//! An occupancy grid around the ego: channels × lanes × cells along the road, for convolutional networks.
//!
//! Grids of this kind are the input of DeepTraffic (Fridman et al., 2018: speeds in cells) and of highway-env's `OccupancyGrid`
//! (Leurent, 2018: presence, speeds and the road in cells). Departures: cells across the road are lanes, a vehicle marks every cell
//! that it covers instead of the one of its center, no lane looks like a wall that stands, and the ego's own state is in planes of
//! one value, so that a convolution sees it everywhere.
//!
//! Lanes run from the left to the right, cells from the rear to the front; the ego is in the middle cell.

use super::{ACCEL_SCALE_MPS2, MEMORY_S, MIDDLE_SPEED_MPS, ObservationConfig, SPEED_SCALE_MPS, Situation, flag};
use crate::road::LaneIndex;
use crate::scene::Scene;

/// The bounds of the channels, in their order.
const BOUNDS: [(f32, f32); CHANNELS] = [
    (0.0, 1.0),
    (-10.0, 10.0),
    (-1.5, 1.5),
    (-10.0, 10.0),
    (0.0, 1.0),
    (0.0, 1.0),
    (-2.5, 7.5),
    (-5.0, 5.0),
    (0.0, 2.0),
    (0.0, 1.0),
];
/// Number of channels: [`Cell`]'s four, the road, the lanes that may be entered, and the ego's speed, acceleration, progress in its
/// lane change and time since the last.
pub(super) const CHANNELS: usize = CELL_CHANNELS + 6;
const CELL_CHANNELS: usize = 4;
/// Channels after those of a cell.
const ROAD: usize = CELL_CHANNELS;
const ALLOWED: usize = ROAD + 1;
const EGO: usize = ALLOWED + 1;
/// Lateral speeds are divided by this, m/s.
const LATERAL_SCALE_MPS: f64 = 1.0;

/// Number of lanes.
pub(super) fn lanes(config: &ObservationConfig) -> usize {
    2 * usize::from(config.lanes_each_side) + 1
}

/// Number of cells in a lane.
pub(super) fn cells(config: &ObservationConfig) -> usize {
    2 * cells_ahead(config) + 1
}

/// Number of cells ahead of the ego's.
fn cells_ahead(config: &ObservationConfig) -> usize {
    (config.range_m / config.cell_length_m).floor() as usize
}

pub(super) fn bound(channel: usize) -> (f32, f32) {
    BOUNDS[channel]
}

pub(super) fn write(config: &ObservationConfig, scene: &Scene, situation: &Situation, out: &mut [f32]) {
    out.fill(0.0);
    let mut grid = Grid { config, scene, lanes: lanes(config), cells: cells(config), out };
    grid.draw_road();
    // Of two vehicles in one cell the nearer one is drawn last and stays.
    let ahead_from = scene.neighbors.partition_point(|n| n.ahead_m < 0.0);
    let (behind, ahead) = scene.neighbors.split_at(ahead_from);
    for n in behind.iter().chain(ahead.iter().rev()).filter(|n| !n.is_lane_end()) {
        let relative_mps = n.speed_mps - scene.ego.speed_mps;
        grid.draw_body(n.ahead_m, n.d_m, (n.length_m, n.width_m), [relative_mps, n.lateral_speed_mps]);
    }
    let ego = &scene.ego;
    let size_m = (scene.ego_length_m, scene.ego_width_m);
    grid.draw_body(0.0, ego.d_m, size_m, [0.0, ego.road_lateral_speed_mps()]);
    grid.draw_situation(situation);
}

struct Grid<'a> {
    config: &'a ObservationConfig,
    scene: &'a Scene,
    lanes: usize,
    cells: usize,
    out: &'a mut [f32],
}

impl Grid<'_> {
    /// The road's lane of a row; none beside the road.
    fn lane(&self, row: usize) -> Option<LaneIndex> {
        let from_right = self.scene.ego_lane.0 + self.config.lanes_each_side;
        let lane = from_right.checked_sub(row as u8)?;
        (lane < self.scene.road.config().lanes).then_some(LaneIndex(lane))
    }

    /// From the ego's center to the middle of a cell, m.
    fn ahead_m(&self, cell: usize) -> f64 {
        (cell as f64 - cells_ahead(self.config) as f64) * self.config.cell_length_m
    }

    fn put(&mut self, (channel, row, cell): (usize, usize, usize), value: f64) {
        self.out[(channel * self.lanes + row) * self.cells + cell] = value as f32;
    }

    /// Writes the channels of one cell: presence, relative speed, offset from the middle of the lane, lateral speed.
    fn put_cell(&mut self, row: usize, cell: usize, values: [f64; CELL_CHANNELS]) {
        for (channel, value) in values.into_iter().enumerate() {
            self.put((channel, row, cell), value);
        }
    }

    /// Where there is no lane stands a wall.
    fn draw_road(&mut self) {
        let scene = self.scene;
        let wall = [1.0, -scene.ego.speed_mps / SPEED_SCALE_MPS, 0.0, 0.0];
        for row in 0..self.lanes {
            let lane = self.lane(row);
            for cell in 0..self.cells {
                let s_m = scene.road.wrap_m(scene.ego.s_m + self.ahead_m(cell));
                if lane.is_some_and(|lane| scene.road.lane_holds(lane, s_m, 0.0)) {
                    self.put((ROAD, row, cell), 1.0);
                } else {
                    self.put_cell(row, cell, wall);
                }
            }
        }
    }

    /// Marks what a body covers: every cell along it in every lane that it touches.
    fn draw_body(&mut self, ahead_m: f64, d_m: f64, (length_m, width_m): (f64, f64), speeds_mps: [f64; 2]) {
        let lane_width_m = self.scene.road.lane_width_m();
        let [first, last] = [-0.5, 0.5].map(|side| {
            let end_m = ahead_m + side * length_m;
            (end_m / self.config.cell_length_m).round() + cells_ahead(self.config) as f64
        });
        if last < 0.0 || first >= self.cells as f64 {
            return;
        }
        for row in 0..self.lanes {
            let Some(lane) = self.lane(row) else { continue };
            let offset_m = d_m - self.scene.road.lane_center_m(lane);
            if offset_m.abs() >= 0.5 * (lane_width_m + width_m) {
                continue;
            }
            let values =
                [1.0, speeds_mps[0] / SPEED_SCALE_MPS, offset_m / lane_width_m, speeds_mps[1] / LATERAL_SCALE_MPS];
            for cell in first.max(0.0) as usize..=(last as usize).min(self.cells - 1) {
                self.put_cell(row, cell, values);
            }
        }
    }

    /// The lanes beside that may be entered now, and the planes of the ego's own state.
    fn draw_situation(&mut self, situation: &Situation) {
        let ego_row = usize::from(self.config.lanes_each_side);
        let planes = [
            (self.scene.ego.speed_mps - MIDDLE_SPEED_MPS) / SPEED_SCALE_MPS,
            self.scene.ego.accel_mps2 / ACCEL_SCALE_MPS2,
            situation.progress,
            situation.since_change_s.min(MEMORY_S) / MEMORY_S,
        ];
        for row in 0..self.lanes {
            let allowed = (row + 1 == ego_row && situation.allowed[0]) || (row == ego_row + 1 && situation.allowed[1]);
            for cell in 0..self.cells {
                self.put((ALLOWED, row, cell), flag(allowed));
                for (plane, value) in planes.into_iter().enumerate() {
                    self.put((EGO + plane, row, cell), value);
                }
            }
        }
    }
}
