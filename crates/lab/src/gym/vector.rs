//! Many environments of a task, stepped on several threads: each writes its own outputs, so that the results do not depend on them.

use std::sync::Arc;

use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::episode_seed;
use super::single::{Actions, Command, Gym, GymError};
use super::task::Task;

/// When an environment whose episode has ended begins the next one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Autoreset {
    /// By the step after, whose action is not read.
    NextStep,
    /// By the same step, which hands over the last observation apart.
    SameStep,
    /// When it is told to.
    Disabled,
}

/// What every step writes, one row for each environment.
#[derive(Debug)]
pub struct Outputs<'a> {
    /// Observations, one after the other.
    pub observations: &'a mut [f32],
    /// Rewards.
    pub rewards: &'a mut [f64],
    /// Whether the episode was terminated.
    pub terminated: &'a mut [bool],
    /// Whether the episode was truncated.
    pub truncated: &'a mut [bool],
    /// Masks, one after the other.
    pub masks: &'a mut [bool],
    /// Measurements, one environment after the other.
    pub metrics: &'a mut [f64],
    /// Last observations of the episodes that ended, with [`Autoreset::SameStep`] only.
    pub final_observations: &'a mut [f32],
    /// Last measurements of the episodes that ended, with [`Autoreset::SameStep`] only.
    pub final_metrics: &'a mut [f64],
}

/// What one environment writes.
struct Row<'a> {
    observation: &'a mut [f32],
    reward: &'a mut f64,
    terminated: &'a mut bool,
    truncated: &'a mut bool,
    mask: &'a mut [bool],
    metrics: &'a mut [f64],
    last: Option<(&'a mut [f32], &'a mut [f64])>,
}

impl<'a> Outputs<'a> {
    fn rows(self, task: &Task, same_step: bool) -> Vec<Row<'a>> {
        let (size, mask, metrics) = (task.observations().size(), task.mask_width(), task.metrics().len());
        let mut observations = self.observations.chunks_exact_mut(size);
        let mut masks = self.masks.chunks_exact_mut(mask.max(1));
        let mut values = self.metrics.chunks_exact_mut(metrics);
        let mut last = self.final_observations.chunks_exact_mut(size).zip(self.final_metrics.chunks_exact_mut(metrics));
        let ends = self.rewards.iter_mut().zip(self.terminated.iter_mut().zip(self.truncated.iter_mut()));
        ends.map(|(reward, (terminated, truncated))| Row {
            observation: observations.next().unwrap_or_default(),
            reward,
            terminated,
            truncated,
            mask: masks.next().unwrap_or_default(),
            metrics: values.next().unwrap_or_default(),
            last: last.next().filter(|_| same_step),
        })
        .collect()
    }
}

/// One of the environments, with the numbers of its episodes.
#[derive(Debug)]
struct Lane {
    gym: Gym,
    seed: u64,
    episode: u64,
}

impl Lane {
    fn new(task: &Arc<Task>, seed: u64) -> Result<Self, GymError> {
        Ok(Self { gym: Gym::new(task, seed)?, seed, episode: 0 })
    }

    fn begin_next(&mut self, task: &Arc<Task>) -> Result<(), GymError> {
        self.episode += 1;
        self.gym = Gym::new(task, episode_seed(self.seed, self.episode))?;
        Ok(())
    }

    /// Without a command the next episode begins.
    fn step(&mut self, task: &Arc<Task>, command: Option<&Command>, row: &mut Row) -> Result<(), GymError> {
        if let Some(command) = command {
            (*row.reward, *row.terminated, *row.truncated) = self.gym.step(command)?;
            if let Some((observation, metrics)) = row.last.as_mut().filter(|_| self.gym.is_over()) {
                self.gym.observe(observation);
                self.gym.metrics(metrics);
                self.begin_next(task)?;
            }
        } else {
            self.begin_next(task)?;
            (*row.reward, *row.terminated, *row.truncated) = (0.0, false, false);
        }
        self.show(row);
        Ok(())
    }

    fn show(&self, row: &mut Row) {
        self.gym.observe(row.observation);
        self.gym.mask(row.mask);
        self.gym.metrics(row.metrics);
    }
}

/// Many environments of one task.
#[derive(Debug)]
pub struct VectorGym {
    task: Arc<Task>,
    lanes: Vec<Lane>,
    autoreset: Autoreset,
    threads: usize,
    pool: Option<ThreadPool>,
    process: u32,
}

impl VectorGym {
    /// One environment for each seed, stepped on so many threads (0: as many as there are processors).
    pub fn new(task: &Arc<Task>, seeds: &[u64], autoreset: Autoreset, threads: usize) -> Result<Self, GymError> {
        let pool = start_pool(threads)?;
        let lane = |(index, seed): (usize, &u64)| Lane::new(task, *seed).map_err(|error| at(index, error));
        let lanes = match &pool {
            None => seeds.iter().enumerate().map(lane).collect(),
            Some(pool) => pool.install(|| seeds.par_iter().enumerate().map(lane).collect::<Result<_, _>>()),
        };
        Ok(Self { task: Arc::clone(task), lanes: lanes?, autoreset, threads, pool, process: std::process::id() })
    }

    /// The environments.
    pub fn gyms(&self) -> impl ExactSizeIterator<Item = &Gym> {
        self.lanes.iter().map(|lane| &lane.gym)
    }

    /// Begins new episodes: of these seeds, or the next ones of the seeds before; only where `chosen`, if given.
    pub fn reset(&mut self, seeds: Option<&[u64]>, chosen: Option<&[bool]>, outputs: Outputs) -> Result<(), GymError> {
        let task = Arc::clone(&self.task);
        self.each_lane(outputs, |index, lane, row| {
            if chosen.is_none_or(|chosen| chosen[index]) {
                match seeds {
                    Some(seeds) => *lane = Lane::new(&task, seeds[index])?,
                    None => lane.begin_next(&task)?,
                }
            }
            (*row.reward, *row.terminated, *row.truncated) = (0.0, false, false);
            lane.show(row);
            Ok(())
        })
    }

    /// One step of every environment.
    ///
    /// # Errors
    /// If an action does not fit, before anything has moved.
    pub fn step(&mut self, actions: Actions, outputs: Outputs) -> Result<(), GymError> {
        let task = Arc::clone(&self.task);
        actions.check(task.actions(), self.lanes.len())?;
        let command = |(index, lane): (usize, &Lane)| {
            let begins = self.autoreset == Autoreset::NextStep && lane.gym.is_over();
            let command = || lane.gym.command(actions.at(index, task.actions().width()));
            (!begins).then(command).transpose().map_err(|error| at(index, error))
        };
        let commands = self.lanes.iter().enumerate().map(command).collect::<Result<Vec<_>, _>>()?;
        self.each_lane(outputs, |index, lane, row| lane.step(&task, commands[index].as_ref(), row))
    }

    /// Does `job` to every environment and its row.
    fn each_lane(
        &mut self,
        outputs: Outputs,
        job: impl Fn(usize, &mut Lane, &mut Row) -> Result<(), GymError> + Sync,
    ) -> Result<(), GymError> {
        self.restart_pool_after_fork()?;
        let mut rows = outputs.rows(&self.task, self.autoreset == Autoreset::SameStep);
        let job = |(index, (lane, row)): (usize, (&mut Lane, &mut Row))| {
            job(index, lane, row).map_err(|error| at(index, error))
        };
        let Some(pool) = &self.pool else {
            return self.lanes.iter_mut().zip(&mut rows).enumerate().try_for_each(job);
        };
        let pairs = self.lanes.par_iter_mut().zip(&mut rows).enumerate();
        let results: Vec<_> = pool.install(|| pairs.map(job).collect());
        results.into_iter().collect()
    }

    /// A forked process has the pool, but none of its threads.
    fn restart_pool_after_fork(&mut self) -> Result<(), GymError> {
        if self.process != std::process::id() {
            // Its end would wait for these threads.
            std::mem::forget(self.pool.take());
            self.pool = start_pool(self.threads)?;
            self.process = std::process::id();
        }
        Ok(())
    }
}

/// One thread needs no pool.
fn start_pool(threads: usize) -> Result<Option<ThreadPool>, GymError> {
    let pool = || ThreadPoolBuilder::new().num_threads(threads).build();
    Ok((threads != 1).then(pool).transpose()?)
}

fn at(index: usize, source: GymError) -> GymError {
    GymError::At { index, source: Box::new(source) }
}
