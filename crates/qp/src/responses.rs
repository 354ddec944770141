//! The responses of constraints, kept as long as the matrices they follow from.

use serde::{Deserialize, Serialize};

use crate::linalg::{Block, LANES, Vector, dot};
use crate::problem::Problem;
use crate::riccati::Riccati;

/// Place of a constraint: its stage, and the index of the row, or NS for the bounds of the input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Place {
    pub(crate) stage: usize,
    pub(crate) index: usize,
}

#[derive(Clone, Debug)]
struct Known<const NX: usize> {
    valid: bool,
    /// Slope of the constraint's value in `x_0`, under the unconstrained feedback.
    initial_slope: Vector<NX>,
    /// z'z.
    curvature: f64,
}

/// Responses z of all constraints (docs/qp.md, Eq. 7), computed when first asked for.
#[derive(Clone, Debug)]
pub(crate) struct Responses<const NX: usize> {
    /// Blocks of a line.
    width: usize,
    per_stage: usize,
    /// One line for each constraint, with N numbers of which stage k uses the first k + 1; the others are 0.
    values: Vec<Block>,
    known: Vec<Known<NX>>,
    /// Inner products of the responses, lower triangle row after row; NaN where not yet computed.
    couplings: Vec<f64>,
    /// Whether `couplings` is in use: it does not pay where the matrices change with every solve.
    remembering: bool,
}

impl<const NX: usize> Responses<NX> {
    pub(crate) fn new(horizon: usize, per_stage: usize) -> Self {
        let unknown = Known { valid: false, initial_slope: [0.0; NX], curvature: 0.0 };
        let width = horizon.div_ceil(LANES);
        Self {
            width,
            per_stage,
            values: vec![[0.0; LANES]; width * horizon * per_stage],
            known: vec![unknown; horizon * per_stage],
            couplings: vec![0.0; horizon * per_stage * (horizon * per_stage + 1) / 2],
            remembering: false,
        }
    }

    pub(crate) fn forget(&mut self) {
        for known in &mut self.known {
            known.valid = false;
        }
        self.remembering = false;
    }

    /// Keeps inner products from now on, until a response changes.
    pub(crate) fn remember_couplings(&mut self) {
        if !self.remembering {
            self.couplings.fill(f64::NAN);
            self.remembering = true;
        }
    }

    /// Inner product of two responses.
    pub(crate) fn couple(&mut self, a: Place, b: Place) -> f64 {
        if !self.remembering {
            return dot(self.response(a), self.response(b));
        }
        let (low, high) = (self.id(a).min(self.id(b)), self.id(a).max(self.id(b)));
        let at = high * (high + 1) / 2 + low;
        if self.couplings[at].is_nan() {
            self.couplings[at] = dot(self.response(a), self.response(b));
        }
        self.couplings[at]
    }

    /// Number of `place` among all constraints.
    pub(crate) fn id(&self, place: Place) -> usize {
        place.stage * self.per_stage + place.index
    }

    /// The place with this number.
    pub(crate) fn place(&self, id: usize) -> Place {
        Place { stage: id / self.per_stage, index: id % self.per_stage }
    }

    /// Makes sure that the response of `place` is the one of `problem`; returns z'z.
    pub(crate) fn learn<const NS: usize>(
        &mut self,
        riccati: &Riccati<NX>,
        problem: &Problem<NX, NS>,
        place: Place,
    ) -> f64 {
        let id = self.id(place);
        if self.known[id].valid {
            return self.known[id].curvature;
        }
        let constraint =
            problem.stages[place.stage].rows.get(place.index).map_or((&[0.0; NX], 1.0), |row| (&row.state, row.input));
        let start = id * self.width;
        let out = &mut self.values[start..=start + place.stage / LANES];
        let initial_slope = riccati.respond(constraint, &mut out.as_flattened_mut()[..=place.stage]);
        let curvature = dot(out, out);
        self.known[id] = Known { valid: true, initial_slope, curvature };
        curvature
    }

    /// z of `place`: one number for each input up to its stage, and zeros up to a whole block.
    pub(crate) fn response(&self, place: Place) -> &[Block] {
        let start = self.id(place) * self.width;
        &self.values[start..=start + place.stage / LANES]
    }

    /// Slope of the value of `place` in `x_0`.
    pub(crate) fn initial_slope(&self, place: Place) -> &Vector<NX> {
        &self.known[self.id(place)].initial_slope
    }
}
