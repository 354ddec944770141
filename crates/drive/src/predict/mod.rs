//! What the other vehicles will do: from a scene to a forecast.

/// Time between two points of a forecast, s.
pub const FORECAST_STEP_S: f64 = 0.1;
/// Points of a forecast after the present one: 5 s, the longest horizon of the controllers.
pub const FORECAST_STEPS: usize = 50;

/// A predicted instant of one vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ForecastPoint {
    /// Distance along the road from the ego's position *now* to this vehicle's center then, m.
    pub ahead_m: f64,
    /// Lateral position of its center, m.
    pub d_m: f64,
    /// Speed along the road, m/s.
    pub speed_mps: f64,
}

/// Predicted motion of every neighbor of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Forecast {
    points: Vec<ForecastPoint>,
}

impl Forecast {
    /// Makes room for `neighbors` vehicles, all points zero; keeps its allocation.
    pub fn reset(&mut self, neighbors: usize) {
        self.points.clear();
        self.points.resize(neighbors * (FORECAST_STEPS + 1), ForecastPoint::default());
    }

    /// The track of neighbor `index` (its index in the scene): `FORECAST_STEPS + 1` points, the first one now.
    pub fn track(&self, index: usize) -> &[ForecastPoint] {
        &self.points[index * (FORECAST_STEPS + 1)..(index + 1) * (FORECAST_STEPS + 1)]
    }

    /// The same track, to be written.
    pub fn track_mut(&mut self, index: usize) -> &mut [ForecastPoint] {
        &mut self.points[index * (FORECAST_STEPS + 1)..(index + 1) * (FORECAST_STEPS + 1)]
    }

    /// Neighbor `index` at `time_s`, between points by linear interpolation, after the last point at constant speed.
    pub fn at(&self, index: usize, time_s: f64) -> ForecastPoint {
        let track = self.track(index);
        let position = (time_s / FORECAST_STEP_S).max(0.0);
        let before = position.floor();
        if before >= FORECAST_STEPS as f64 {
            let last = track[FORECAST_STEPS];
            let beyond_s = time_s - FORECAST_STEPS as f64 * FORECAST_STEP_S;
            return ForecastPoint { ahead_m: last.ahead_m + beyond_s * last.speed_mps, ..last };
        }
        let (a, b, share) = (track[before as usize], track[before as usize + 1], position - before);
        ForecastPoint {
            ahead_m: a.ahead_m + share * (b.ahead_m - a.ahead_m),
            d_m: a.d_m + share * (b.d_m - a.d_m),
            speed_mps: a.speed_mps + share * (b.speed_mps - a.speed_mps),
        }
    }
}
