//! The parts of the loop.

/// A part of the loop, for those who measure where time goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// From the world to the scene.
    Perception,
    /// From the scene to the forecast.
    Forecast,
    /// Windows and choice of lane-change paths.
    Planner,
    /// The longitudinal controller.
    LongitudinalMpc,
    /// The lateral controller.
    LateralMpc,
    /// The guard.
    Guard,
    /// The car's dynamics.
    Plant,
    /// The other vehicles.
    Traffic,
}

impl Part {
    /// All parts in the order of the loop.
    pub const ALL: [Self; 8] = [
        Self::Perception,
        Self::Forecast,
        Self::Planner,
        Self::LongitudinalMpc,
        Self::LateralMpc,
        Self::Guard,
        Self::Plant,
        Self::Traffic,
    ];

    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Perception => "perception",
            Self::Forecast => "forecast",
            Self::Planner => "planner",
            Self::LongitudinalMpc => "longitudinal MPC",
            Self::LateralMpc => "lateral MPC",
            Self::Guard => "guard",
            Self::Plant => "plant",
            Self::Traffic => "traffic",
        }
    }
}
