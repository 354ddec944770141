//! The least value of a function in a box, without slopes: the simplex method of Nelder and Mead (1965), started again until it
//! finds nothing better.
//!
//! The box is scaled to the unit cube and points are moved back to its walls, where the simplex can collapse; a fresh simplex
//! around the best point undoes that. Nothing is drawn, so that equal functions give equal bits.

/// A closed range of one parameter.
pub(super) type Range = (f64, f64);

/// Edge of a fresh simplex, in shares of the box.
const EDGE: f64 = 0.15;
/// A simplex whose values differ relatively by no more than this has arrived.
const FLAT: f64 = 1e-7;
/// Most simplices from one start, and most steps of each.
const MOST_SIMPLICES: usize = 6;
const MOST_STEPS: usize = 250;

/// The best point found and its value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Found<const N: usize> {
    /// Where.
    pub(super) point: [f64; N],
    /// How much.
    pub(super) value: f64,
}

/// Searches `ranges` from `start`.
pub(super) fn minimize<const N: usize>(
    ranges: &[Range; N],
    start: [f64; N],
    of: impl Fn(&[f64; N]) -> f64,
) -> Found<N> {
    let inside = |unit: &[f64; N]| std::array::from_fn(|i| ranges[i].0 + unit[i] * (ranges[i].1 - ranges[i].0));
    let value = |unit: &[f64; N]| of(&inside(unit));
    let unit: [f64; N] = std::array::from_fn(|i| (start[i] - ranges[i].0) / (ranges[i].1 - ranges[i].0));
    let mut best = Found { point: unit, value: value(&unit) };
    for _ in 0..MOST_SIMPLICES {
        let next = descend(best, &value);
        let gain = best.value - next.value;
        best = next;
        if gain <= 1e-4 * best.value.abs() {
            break;
        }
    }
    Found { point: inside(&best.point), ..best }
}

/// One simplex from `start` to its end.
fn descend<const N: usize>(start: Found<N>, of: &impl Fn(&[f64; N]) -> f64) -> Found<N> {
    let at = |point: [f64; N]| {
        let point = point.map(|x| x.clamp(0.0, 1.0));
        Found { point, value: of(&point) }
    };
    let mut simplex = vec![start];
    simplex.extend((0..N).map(|axis| {
        let mut point = start.point;
        point[axis] += if point[axis] > 0.5 { -EDGE } else { EDGE };
        at(point)
    }));
    for _ in 0..MOST_STEPS {
        // A stable sort: of equal ones the older stays ahead.
        simplex.sort_by(|a, b| a.value.total_cmp(&b.value));
        let (best, worst) = (simplex[0], simplex[N]);
        if worst.value - best.value <= FLAT * best.value.abs() {
            break;
        }
        let center: [f64; N] = std::array::from_fn(|i| simplex[..N].iter().map(|f| f.point[i]).sum::<f64>() / N as f64);
        let along = |share: f64| at(std::array::from_fn(|i| center[i] + share * (worst.point[i] - center[i])));
        let reflected = along(-1.0);
        let candidate = if reflected.value < best.value {
            let expanded = along(-2.0);
            if expanded.value < reflected.value { expanded } else { reflected }
        } else if reflected.value < simplex[N - 1].value {
            reflected
        } else {
            along(if reflected.value < worst.value { -0.5 } else { 0.5 })
        };
        if candidate.value < worst.value {
            simplex[N] = candidate;
        } else {
            for vertex in &mut simplex[1..] {
                *vertex = at(std::array::from_fn(|i| 0.5 * (best.point[i] + vertex.point[i])));
            }
        }
    }
    simplex.into_iter().min_by(|a, b| a.value.total_cmp(&b.value)).unwrap_or(start)
}

#[cfg(test)]
mod tests {
    use super::minimize;

    #[test]
    fn the_valley_of_rosenbrock_is_followed_to_its_end() {
        let rosenbrock = |p: &[f64; 2]| {
            let (a, b) = (1.0 - p[0], p[1] - p[0] * p[0]);
            1e-3 + a * a + 100.0 * b * b
        };
        let found = minimize(&[(-2.0, 2.0), (-1.0, 3.0)], [-1.2, 1.0], rosenbrock);
        // The value is flat to 1e-7 of 1e-3 about 1e-4 around the minimum.
        assert!((found.point[0] - 1.0).abs() < 1e-2 && (found.point[1] - 1.0).abs() < 2e-2, "{found:?}");
    }

    #[test]
    fn a_minimum_outside_is_met_at_the_wall() {
        let found = minimize(&[(0.0, 1.0), (0.0, 1.0), (0.0, 1.0)], [0.5; 3], |p| {
            1.0 + (p[0] - 2.0) * (p[0] - 2.0) + (p[1] - 0.3) * (p[1] - 0.3) + (p[2] + 1.0) * (p[2] + 1.0)
        });
        // The value is flat to 1e-7 of 2 about 3e-4 around the minimum on the wall.
        assert!(
            found.point.iter().zip([1.0, 0.3, 0.0]).all(|(found, truth)| (found - truth).abs() < 1e-3),
            "{found:?}"
        );
    }
}
