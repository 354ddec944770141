use super::{Lstm, LstmShape, LstmWorkspace};
use crate::kernel::archs;
use crate::random::Stream;

const SHAPE: LstmShape = LstmShape { inputs: 5, hidden: 19, outputs: 3 };

fn random(stream: &mut Stream, n: usize) -> Vec<f32> {
    (0..n).map(|_| stream.range(-1.0, 1.0) as f32).collect()
}

/// A network of which no part is zero.
fn network(shape: LstmShape, stream: &mut Stream) -> Lstm {
    let mut network = Lstm::new(shape, stream).unwrap();
    network.parameters_mut().iter_mut().for_each(|parameter| *parameter += 0.3 * stream.normal() as f32);
    network
}

/// Numbers of the committed file, by name.
fn peer(name: &str) -> Vec<f64> {
    let text = include_str!("../../tests/data/lstm.txt");
    let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' ')).unwrap();
    line.split(' ').map(|value| value.parse().unwrap()).collect()
}

fn single(values: &[f64]) -> Vec<f32> {
    values.iter().map(|&value| value as f32).collect()
}

#[test]
fn outputs_and_gradient_are_those_of_pytorch() {
    let [inputs, hidden, outputs] = peer("shape")[..] else { panic!("three widths") };
    let shape = LstmShape { inputs: inputs as usize, hidden: hidden as usize, outputs: outputs as usize };
    let network = Lstm::from_parameters(shape, single(&peer("parameters"))).unwrap();
    let (x, steps) = (single(&peer("inputs")), peer("steps")[0] as usize);
    let mut workspace = LstmWorkspace::new(&shape, 8, 6);
    let y = network.forward(&x, steps, &mut workspace);
    let delta: Vec<f32> = y.iter().zip(peer("targets")).map(|(y, target)| y - target as f32).collect();
    // PyTorch calculated in double precision; ours is off by a few roundings of values of about 1.
    assert_eq!(y.len(), peer("outputs").len());
    assert!(y.iter().zip(peer("outputs")).all(|(y, peer)| (f64::from(*y) - peer).abs() < 1e-6));
    let mut gradient = vec![f32::NAN; network.parameters().len()];
    network.backward(&x, &delta, &mut workspace, &mut gradient);
    assert_eq!(gradient.len(), peer("gradient").len());
    for (index, (ours, peer)) in gradient.iter().zip(peer("gradient")).enumerate() {
        assert!((f64::from(*ours) - peer).abs() < 2e-6, "gradient {index}: {ours} in place of {peer}");
    }
}

#[test]
fn the_gradient_is_that_of_central_differences() {
    for (seed, steps, batch) in [(1, 7, 4), (2, 1, 3), (3, 2, 1)] {
        let mut stream = Stream::new(seed, "lstm.gradient");
        let network = network(SHAPE, &mut stream);
        let (x, c) = (random(&mut stream, steps * batch * SHAPE.inputs), random(&mut stream, batch * SHAPE.outputs));
        let mut workspace = LstmWorkspace::new(&SHAPE, batch, steps);
        // L = Σ c y + y²/2, in f64.
        let mut loss = |network: &Lstm| -> f64 {
            let y = network.forward(&x, steps, &mut workspace);
            y.iter().zip(&c).map(|(y, c)| f64::from(*y) * (f64::from(*c) + 0.5 * f64::from(*y))).sum()
        };
        // A step of 2⁻⁷ leaves the rounding of the f32 sums (about 1e-6) near 1e-4 in the quotient, and its own error of second order
        // near as much.
        let step = 1.0 / 128.0_f32;
        let numeric: Vec<f64> = (0..network.parameters().len())
            .map(|index| {
                let mut at = |shift: f32| {
                    let mut moved = network.clone();
                    moved.parameters_mut()[index] += shift;
                    loss(&moved)
                };
                (at(step) - at(-step)) / (2.0 * f64::from(step))
            })
            .collect();
        let y = network.forward(&x, steps, &mut workspace);
        let delta: Vec<f32> = y.iter().zip(&c).map(|(y, c)| y + c).collect();
        let mut gradient = vec![f32::NAN; numeric.len()];
        network.backward(&x, &delta, &mut workspace, &mut gradient);
        for (analytic, numeric) in gradient.iter().zip(numeric) {
            assert!((f64::from(*analytic) - numeric).abs() < 2e-3 * (1.0 + numeric.abs()), "{analytic} {numeric}");
        }
    }
}

#[test]
fn every_vector_width_gives_the_same_bits() {
    let mut stream = Stream::new(4, "lstm.widths");
    let (steps, batch) = (6, 5);
    let network = network(SHAPE, &mut stream);
    let (x, delta) = (random(&mut stream, steps * batch * SHAPE.inputs), random(&mut stream, batch * SHAPE.outputs));
    let results: Vec<(Vec<f32>, Vec<f32>)> = archs()
        .into_iter()
        .map(|arch| {
            let mut workspace = LstmWorkspace::with_arch(&SHAPE, batch, steps, arch);
            let y = network.forward(&x, steps, &mut workspace).to_vec();
            let mut gradient = vec![0.0; network.parameters().len()];
            network.backward(&x, &delta, &mut workspace, &mut gradient);
            (y, gradient)
        })
        .collect();
    assert!(results.iter().all(|result| *result == results[0]));
}

#[test]
fn a_sequence_has_the_same_bits_alone_and_in_a_batch() {
    let mut stream = Stream::new(5, "lstm.rows");
    let (steps, batch) = (4, 9);
    let network = network(SHAPE, &mut stream);
    let x = random(&mut stream, steps * batch * SHAPE.inputs);
    let (mut all, mut single) = (LstmWorkspace::new(&SHAPE, 16, 8), LstmWorkspace::new(&SHAPE, 1, 4));
    let together = network.forward(&x, steps, &mut all);
    for row in 0..batch {
        let of_row = |step: usize| &x[(step * batch + row) * SHAPE.inputs..(step * batch + row + 1) * SHAPE.inputs];
        let alone: Vec<f32> = (0..steps).flat_map(of_row).copied().collect();
        let outputs = row * SHAPE.outputs..(row + 1) * SHAPE.outputs;
        assert_eq!(&together[outputs], network.forward(&alone, steps, &mut single));
    }
}

#[test]
fn an_untrained_network_says_nothing_and_a_seed_repeats() {
    let build = |seed| Lstm::new(SHAPE, &mut Stream::new(seed, "init")).unwrap();
    assert_eq!(build(1), build(1));
    assert_ne!(build(1), build(2));
    let mut workspace = LstmWorkspace::new(&SHAPE, 2, 3);
    let y = build(1).forward(&[0.7; 2 * 3 * 5], 3, &mut workspace).to_vec();
    assert_eq!(y, [0.0; 6]);
}

#[test]
fn something_to_remember_is_learned() {
    // Was the first of eight inputs positive? What comes after it is noise.
    let shape = LstmShape { inputs: 1, hidden: 8, outputs: 1 };
    let mut stream = Stream::new(6, "lstm.task");
    let mut network = Lstm::new(shape, &mut stream).unwrap();
    let (batch, steps) = (32, 8);
    let mut adam = crate::Adam::new(network.parameters().len());
    let mut workspace = LstmWorkspace::new(&shape, batch, steps);
    let mut gradient = vec![0.0; network.parameters().len()];
    let mut losses = Vec::new();
    for _ in 0..1000 {
        let x = random(&mut stream, steps * batch);
        let y = network.forward(&x, steps, &mut workspace);
        let delta: Vec<f32> = y.iter().zip(&x).map(|(y, first)| (y - first.signum()) / batch as f32).collect();
        losses.push(delta.iter().map(|delta| delta * delta).sum::<f32>() * batch as f32);
        network.backward(&x, &delta, &mut workspace, &mut gradient);
        adam.step(network.parameters_mut(), &gradient, 1e-2);
    }
    let mean = |losses: &[f32]| losses.iter().sum::<f32>() / losses.len() as f32;
    // Zero everywhere costs 1; the first input is seen through seven steps of noise.
    assert!(mean(&losses[..10]) > 0.8 && mean(&losses[950..]) < 0.2, "{}", mean(&losses[950..]));
}

#[test]
fn wrong_shapes_are_refused() {
    let shape = |inputs, hidden, outputs| LstmShape { inputs, hidden, outputs };
    for bad in [shape(0, 4, 2), shape(4, 0, 2), shape(4, 4, 0), shape(4, 1 << 20, 2)] {
        assert!(Lstm::new(bad, &mut Stream::new(1, "init")).is_err());
    }
    assert!(Lstm::from_parameters(shape(4, 4, 2), vec![0.0; 3]).is_err());
    let slots = SHAPE.tensors();
    assert_eq!(slots.last().unwrap().range.end, SHAPE.parameter_count());
    assert_eq!(SHAPE.parameter_count(), 4 * 19 * (5 + 19 + 1) + 19 * 3 + 3);
    assert!(slots.iter().all(|slot| slot.shape.iter().product::<usize>() == slot.range.len()));
}
