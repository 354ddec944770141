//! Commands on their way through an actuator's pure delay: what the car will still do before a new command counts.

use serde::{Deserialize, Serialize};
use serde_big_array::BigArray;

use crate::vehicle::MAX_DELAY_S;

/// Shortest control period there is, s.
const PERIOD_MIN_S: f64 = 0.01;
/// The longest delay in the shortest periods, the piece of one more, and the one before it.
const CAPACITY: usize = (MAX_DELAY_S / PERIOD_MIN_S) as usize + 3;
/// A delay this close to whole periods is whole, in periods.
const WHOLE: f64 = 1e-9;

/// The last commands of one actuator, one for each control period.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SentCommands {
    period_s: f64,
    /// Whole periods in the delay.
    whole: usize,
    /// What is left of the delay, s.
    rest_s: f64,
    /// Newest first.
    #[serde(with = "BigArray")]
    commands: [f64; CAPACITY],
}

impl SentCommands {
    /// No commands yet: all zero.
    pub(crate) fn new(delay_s: f64, period_s: f64) -> Self {
        let periods = delay_s / period_s;
        let whole = ((periods + WHOLE).floor() as usize).min(CAPACITY - 2);
        let rest = periods - whole as f64;
        let rest_s = if rest > WHOLE { rest * period_s } else { 0.0 };
        Self { period_s, whole, rest_s, commands: [0.0; CAPACITY] }
    }

    /// The delay, s.
    pub(crate) fn delay_s(&self) -> f64 {
        self.whole as f64 * self.period_s + self.rest_s
    }

    /// The part of the delay that is no whole period, s.
    pub(crate) fn rest_s(&self) -> f64 {
        self.rest_s
    }

    /// Notes the command of this period.
    pub(crate) fn push(&mut self, command: f64) {
        let used = (self.whole + 2).min(CAPACITY - 1);
        self.commands.copy_within(0..used, 1);
        self.commands[0] = command;
    }

    /// Corrects the last command: what was sent is not what was asked for.
    pub(crate) fn amend(&mut self, command: f64) {
        self.commands[0] = command;
    }

    /// From now until a new command counts: how long each command acts, s, and the command.
    pub(crate) fn under_way(&self) -> impl Iterator<Item = (f64, f64)> {
        let piece = (self.rest_s > 0.0).then(|| (self.rest_s, self.commands[self.whole]));
        piece.into_iter().chain((0..self.whole).rev().map(|index| (self.period_s, self.commands[index])))
    }

    /// What acted in the period that ends now, in the same way.
    pub(crate) fn acted(&self) -> [(f64, f64); 2] {
        let newer = (self.period_s - self.rest_s, self.commands[self.whole]);
        [(self.rest_s, self.commands[self.whole + 1]), newer]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_under_way_fills_the_delay() {
        let mut sent = SentCommands::new(0.12, 0.05);
        for command in 1..=5 {
            sent.push(f64::from(command));
        }
        // Sent 0.15, 0.10 and 0.05 s ago; the oldest has 0.02 s left to act.
        let pieces: Vec<(f64, f64)> = sent.under_way().collect();
        assert_eq!(pieces.iter().map(|piece| piece.1).collect::<Vec<_>>(), [3.0, 4.0, 5.0]);
        assert!((pieces[0].0 - 0.02).abs() < 1e-12 && (sent.delay_s() - 0.12).abs() < 1e-12);
        assert_eq!(sent.acted().map(|piece| piece.1), [2.0, 3.0]);
    }

    #[test]
    fn without_delay_nothing_is_under_way() {
        let mut sent = SentCommands::new(0.0, 0.05);
        sent.push(1.0);
        assert_eq!(sent.under_way().count(), 0);
        assert_eq!(sent.acted(), [(0.0, 0.0), (0.05, 1.0)]);
        assert_eq!(SentCommands::new(0.15, 0.05).under_way().count(), 3);
        assert_eq!(SentCommands::new(MAX_DELAY_S, PERIOD_MIN_S).under_way().count(), 50);
    }
}
