//! A beam search over decisions, with clones of the simulator itself as its model: nothing is simplified, and nothing hidden.
//!
//! From every decision of a member of the beam each allowed action is tried. An action that begins a lane change is followed up to the
//! next decision, several ticks later, and waits there: members are only compared at equal ticks, so nobody is dropped in the middle of
//! a lane change for what it costs before it pays.
//!
//! Among the members of a tick the sum of the scores so far decides, within a quota for each lane, without which a beam soon drives in
//! one lane alone. Of members in the same cell of lane, place and speed only the best is kept. Ties go to whoever was found first, so
//! the result does not depend on the number of threads.

use std::collections::BTreeSet;

use lanecraft_drive::env::{Env, Episode};
use rayon::prelude::*;

/// Size of a cell along the road, m, and in speed, m/s: members of the same cell are duplicates. Cells must be coarse, or a beam is full
/// of drives that differ in nothing but how they keep their lane: in two tuning scenarios a beam of 12 earned 8.58 a tick with cells of
/// 1 m and 0.5 m/s, 8.99 with 4 m and 1 m/s, 9.06 with these and 8.74 with 20 m and 4 m/s.
const CELL_M: f64 = 10.0;
const CELL_MPS: f64 = 2.0;
/// Members that are followed up at a time; bounds how many environments are held.
const CHUNK: usize = 64;

/// The best drive that was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Drive {
    /// The action of each tick from the start on.
    pub actions: Vec<u8>,
    /// What was measured of it.
    pub episode: Episode,
    /// Ticks that were simulated to find it.
    pub simulated_ticks: u64,
}

/// A drive so far, at a decision or at the end.
struct Member {
    env: Env,
    actions: Vec<u8>,
}

/// The best drive from `start`, where a decision is due, to the end of its episode without a collision, by a beam of `width` members;
/// `None` if each one that was tried collides. Calls `tick_done` after each tick of the episode.
pub fn search(start: &Env, width: usize, tick_done: &dyn Fn()) -> Option<Drive> {
    let last = start.periods().ticks as usize;
    // By tick: where members wait for the others.
    let mut waiting: Vec<Vec<Member>> = (0..=last).map(|_| Vec::new()).collect();
    let mut simulated_ticks = 0;
    waiting[start.episode().ticks as usize].push(Member { env: start.clone(), actions: Vec::new() });
    for tick in start.episode().ticks as usize..last {
        let mut beam = std::mem::take(&mut waiting[tick]);
        thin(&mut beam, width);
        for members in beam.chunks(CHUNK) {
            let followers: Vec<_> = members.par_iter().map(Member::followers).collect();
            for (members, ticks) in followers {
                simulated_ticks += ticks;
                for member in members {
                    waiting[member.env.episode().ticks as usize].push(member);
                }
            }
            waiting.iter_mut().filter(|members| members.len() > 2 * width).for_each(|members| thin(members, width));
        }
        tick_done();
    }
    let mut ends = std::mem::take(&mut waiting[last]);
    thin(&mut ends, 1);
    let Member { env, actions } = ends.pop()?;
    Some(Drive { actions, episode: *env.episode(), simulated_ticks })
}

impl Member {
    fn score(&self) -> f64 {
        self.env.episode().score_sum
    }

    fn lane(&self) -> u8 {
        self.env.driver().target_lane().0
    }

    fn cell(&self) -> (u8, i64, i64) {
        let cell = |value: f64, size: f64| (value / size).floor() as i64;
        (self.lane(), cell(self.env.driven_m(), CELL_M), cell(self.env.ego().speed_mps, CELL_MPS))
    }

    /// What each allowed action leads to, but for collisions, and the ticks that this took.
    fn followers(&self) -> (Vec<Self>, u64) {
        let mut ticks = 0;
        let allowed = (0..self.env.actions().len()).filter(|&action| self.env.mask().allows(action));
        (allowed.filter_map(|action| self.after(action, &mut ticks)).collect(), ticks)
    }

    /// The next decision after `action`, or the end; `None` after a collision.
    fn after(&self, action: usize, ticks: &mut u64) -> Option<Self> {
        let (mut env, mut actions) = (self.env.clone(), self.actions.clone());
        let mut action = action;
        loop {
            let outcome = env.step(action).expect("the mask allows it");
            actions.push(u8::try_from(action).expect("a mask has 32 bits"));
            *ticks += 1;
            if outcome.terminated {
                return None;
            }
            if outcome.truncated || env.decision_due() {
                return Some(Self { env, actions });
            }
            action = env.actions().continue_action();
        }
    }
}

/// Keeps the best `width` members, the best one of each cell, each lane with an equal share of places as far as it has members for it.
fn thin(members: &mut Vec<Member>, width: usize) {
    members.sort_by(|a, b| b.score().total_cmp(&a.score()));
    let mut cells = BTreeSet::new();
    members.retain(|member| cells.insert(member.cell()));
    let lanes: BTreeSet<u8> = members.iter().map(Member::lane).collect();
    let quota = width / lanes.len().max(1);
    let mut of_lane = [0; 256];
    let (mut kept, rest): (Vec<_>, Vec<_>) = members.drain(..).partition(|member| {
        let count = &mut of_lane[usize::from(member.lane())];
        *count += 1;
        *count <= quota
    });
    let places = width - kept.len();
    kept.extend(rest.into_iter().take(places));
    *members = kept;
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use lanecraft_drive::env::{Config, Env};

    use super::{Drive, search};
    use crate::config::SeedRole;

    /// A quarter of a minute, from which a narrow beam makes something in a second.
    fn start(index: u64) -> Env {
        let mut config = Config::default();
        config.env.episode_s = 15.0;
        Env::new(&Arc::new(config), SeedRole::Tuning.scenario_seed(0, index)).unwrap()
    }

    fn found(start: &Env, width: usize, threads: usize) -> Drive {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| search(start, width, &|| ())).unwrap()
    }

    #[test]
    fn what_is_found_can_be_driven_and_earns_what_was_said() {
        let start = start(0);
        let drive = found(&start, 3, 2);
        let mut env = start.clone();
        for &action in &drive.actions {
            assert!(!env.step(usize::from(action)).unwrap().terminated);
        }
        assert!(env.is_over());
        assert_eq!(*env.episode(), drive.episode);
    }

    #[test]
    fn the_drive_does_not_depend_on_the_number_of_threads() {
        let start = start(1);
        assert_eq!(found(&start, 3, 1), found(&start, 3, 3));
    }

    #[test]
    fn a_beam_of_one_earns_no_more_than_a_wide_one_and_less_work() {
        let start = start(2);
        let (narrow, wide) = (found(&start, 1, 2), found(&start, 8, 2));
        assert!(narrow.episode.score_sum <= wide.episode.score_sum);
        assert!(narrow.simulated_ticks < wide.simulated_ticks);
    }
}
