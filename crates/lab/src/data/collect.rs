//! Takes the rows of a reader, in any order, and hands each to what is held of its site and vehicle.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::error::DataError;
use super::events::RoadKind;
use super::recording::{Format, Oddities, Oddity, Sample, Selection, count};

/// A row as a reader hands it in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub(super) vehicle_id: u32,
    pub(super) length_m: f64,
    pub(super) width_m: f64,
    /// Count of frames since any origin.
    pub(super) frame: i64,
    pub(super) lane: u32,
    pub(super) x_m: f64,
    pub(super) y_m: f64,
    pub(super) speed_mps: f64,
}

/// What a reader tells of a file as a whole.
pub(super) struct Source {
    pub(super) format: Format,
    pub(super) rate_hz: f64,
    /// Kind of road by name of the site.
    pub(super) road: fn(&str) -> RoadKind,
}

/// Source id and size in millimeters: what tells vehicles apart.
pub(super) type Key = (u32, u32, u32);

/// What is held of one site.
pub(super) trait Held: Default {
    /// Takes a sample, whose frame counts from that of the site's first row, at `rate_hz`.
    fn take(&mut self, key: Key, sample: Sample, rate_hz: f64);
}

/// What is held of each vehicle. Rows of one vehicle often follow each other, so the last one is found without a search.
#[derive(Default)]
pub(super) struct ByVehicle<T> {
    places: BTreeMap<Key, usize>,
    held: Vec<T>,
    last: Option<(Key, usize)>,
}

impl<T: Default> ByVehicle<T> {
    pub(super) fn of(&mut self, key: Key) -> &mut T {
        let place = match self.last {
            Some((last, place)) if last == key => place,
            _ => *self.places.entry(key).or_insert(self.held.len()),
        };
        if place == self.held.len() {
            self.held.push(T::default());
        }
        self.last = Some((key, place));
        &mut self.held[place]
    }

    /// What is held, by rising key; `T` is left empty.
    pub(super) fn take_in_order(&mut self) -> impl Iterator<Item = (Key, T)> + '_ {
        self.places.iter().map(|(key, place)| (*key, std::mem::take(&mut self.held[*place])))
    }
}

/// Puts rows together by site.
pub(super) struct Collector<'a, S> {
    path: PathBuf,
    selection: &'a Selection,
    /// By name; each with the frame of its first row.
    sites: BTreeMap<String, (i64, S)>,
    rows: usize,
    pub(super) oddities: Oddities,
}

impl<'a, S: Held> Collector<'a, S> {
    pub(super) fn new(path: &Path, selection: &'a Selection) -> Self {
        let (sites, oddities) = (BTreeMap::new(), Oddities::new());
        Self { path: path.to_owned(), selection, sites, rows: 0, oddities }
    }

    /// Counts something odd.
    pub(super) fn count(&mut self, oddity: Oddity, times: u64) {
        count(&mut self.oddities, oddity, times);
    }

    /// Takes a row recorded at `rate_hz`, if its site is wanted.
    pub(super) fn push(&mut self, site: &str, rate_hz: f64, row: &Row) -> Result<(), DataError> {
        if !site.starts_with(&self.selection.sites) {
            self.count(Oddity::RowsOfOtherSites, 1);
            return Ok(());
        }
        if self.rows == self.selection.max_samples {
            return Err(DataError::TooBig { path: self.path.clone(), limit: self.rows });
        }
        self.rows += 1;
        if !self.sites.contains_key(site) {
            self.sites.insert(site.to_owned(), (row.frame, S::default()));
        }
        let Some((first_frame, held)) = self.sites.get_mut(site) else { unreachable!("the site was put in") };
        let frame = i32::try_from(row.frame - *first_frame).ok().filter(|frame| frame.abs() < i32::MAX / 2);
        let Some(frame) = frame else {
            return Err(DataError::Times { path: self.path.clone(), site: site.to_owned() });
        };
        let millimeters = |size_m: f64| (1e3 * size_m).round() as u32;
        let key = (row.vehicle_id, millimeters(row.length_m), millimeters(row.width_m));
        let sample = Sample { frame, lane: row.lane, x_m: row.x_m, y_m: row.y_m, speed_mps: row.speed_mps };
        held.take(key, sample, rate_hz);
        Ok(())
    }

    /// What is held of each site, by its name; at least one.
    pub(super) fn take_sites(&mut self) -> Result<Vec<(String, S)>, DataError> {
        if self.sites.is_empty() {
            return Err(DataError::Empty { path: self.path.clone() });
        }
        Ok(std::mem::take(&mut self.sites).into_iter().map(|(site, (_, held))| (site, held)).collect())
    }
}
