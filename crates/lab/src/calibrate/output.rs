//! What a calibration leaves: an overlay for `--config`, tables and figures.

use std::fmt::Write as _;

use lanecraft_drive::scenario::Distribution;

use super::{Calibration, Parameter, quantile};
use crate::data::traffic::FRAME_S;
use crate::metrics::Interval;
use crate::report::svg::{Axis, Plot};
use crate::studies::{Figure, StudyReport, Table};

/// Bars of a histogram.
const BARS: usize = 12;

impl Calibration {
    /// The drivers found as TOML to lay over a preset.
    pub fn overlay_toml(&self) -> String {
        let mut text = format!(
            "# Human drivers as in {} episodes of car following by {} drivers at {} sites, at {:.1} m/s.\n\
             # Nobody drove freely there: the desired speed fits to the rest, but is none for an empty road.\n[traffic]\n",
            self.episodes, self.drivers, self.sites_used, self.lane_changes.speed_mps
        );
        for parameter in &self.parameters {
            let _ = writeln!(text, "{} = {}", parameter.key, inline(&parameter.distribution));
        }
        text
    }

    /// Tables and figures.
    pub fn report(&self) -> StudyReport {
        let figures = self.shown.iter().enumerate().map(|(index, _)| self.gap_figure(index));
        let own = self.parameters.iter().filter(|parameter| !parameter.drivers.is_empty());
        StudyReport {
            name: "calibration",
            title: "Human drivers from recorded traffic".to_owned(),
            summary: self.summary(),
            tables: vec![self.law_table(), self.parameter_table(), self.lane_change_table()],
            figures: figures.chain(own.map(histogram)).collect(),
        }
    }

    fn summary(&self) -> String {
        format!(
            "{} episodes of at least 5 s behind one leader, {:.0} min in all, by {} drivers at {} sites at {:.1} m/s and {:.0} vehicles \
             per kilometer and lane. Errors are those on the site left out, intervals are over resampled drivers. Drivers' own \
             parameters come within {:.2} m on the episodes that they were fitted to.",
            self.episodes,
            self.duration_s / 60.0,
            self.drivers,
            self.sites_used,
            self.lane_changes.speed_mps,
            self.lane_changes.density_veh_per_km_lane,
            self.own_gap_rmse_m
        )
    }

    fn law_table(&self) -> Table {
        let head = ["law", "gap error, m", "speed error, m/s", "relative gap error, %"];
        let mut table = Table::new("laws", "Root mean square errors on the site left out", &head);
        table.rows = self
            .judged
            .iter()
            .map(|judged| {
                let percent = scaled(judged.relative_gap_error, 100.0);
                vec![judged.law.into(), cell(judged.gap_rmse_m, 2), cell(judged.speed_rmse_mps, 2), cell(percent, 1)]
            })
            .collect();
        table
    }

    fn parameter_table(&self) -> Table {
        let head =
            ["parameter", "all drivers in common", "drivers: 5 %", "25 %", "50 %", "75 %", "95 %", "at a wall, %"];
        let mut table = Table::new("parameters", "Parameters of IDM, and their quantiles over drivers", &head);
        table.rows = self
            .parameters
            .iter()
            .map(|Parameter { key, pooled, drivers, at_wall, .. }| {
                let own = |text: String| if drivers.is_empty() { String::new() } else { text };
                let mut row = vec![(*key).to_owned(), cell(*pooled, 2)];
                row.extend([0.05, 0.25, 0.5, 0.75, 0.95].map(|share| own(format!("{:.2}", quantile(drivers, share)))));
                row.push(own(format!("{:.0}", 100.0 * at_wall)));
                row
            })
            .collect();
        table
    }

    fn lane_change_table(&self) -> Table {
        let head = ["traffic", "changes per vehicle-km", "mean speed, m/s", "front gap, m", "rear gap, m"];
        let mut table = Table::new("lane-changes", "Lane changes at the recorded density; gaps: 5 %, median", &head);
        let gaps = |gaps_m: &[f64]| match gaps_m {
            [] => "none".to_owned(),
            _ => format!("{:.1}, {:.1}", quantile(gaps_m, 0.05), quantile(gaps_m, 0.5)),
        };
        let recorded = &self.lane_changes;
        table.rows.push(vec![
            format!("recorded, {} changes", recorded.changes),
            cell(recorded.per_vehicle_km(), 2),
            format!("{:.1}", recorded.speed_mps),
            gaps(&recorded.front_gaps_m),
            gaps(&recorded.rear_gaps_m),
        ]);
        for (name, model) in ["model, default", "model, calibrated"].into_iter().zip(self.model_traffic) {
            let rate = format!("{:.2}", model.changes_per_vehicle_km);
            table.rows.push(vec![
                name.to_owned(),
                rate,
                format!("{:.1}", model.speed_mps),
                String::new(),
                String::new(),
            ]);
        }
        table
    }

    /// Gap over time: recorded, with the driver's own parameters, with the common ones.
    fn gap_figure(&self, index: usize) -> Figure {
        let shown = &self.shown[index];
        let episode = &shown.episode;
        let recorded: Vec<f64> = (0..episode.follower.len()).map(|step| episode.gap_m(step)).collect();
        let driven = |law: super::Law| law.drive(episode).into_iter().map(|state| state.0).collect::<Vec<_>>();
        let curves =
            [("recorded", recorded), ("own parameters", driven(shown.own)), ("common parameters", driven(self.law))];
        let gaps = curves.iter().flat_map(|curve| curve.1.iter().copied());
        let mut plot =
            Plot::new(Axis::exactly("time, s", 0.0, episode.duration_s()), Axis::over("gap, m", gaps.chain([0.0])));
        for (series, (_, gaps_m)) in curves.iter().enumerate() {
            let points: Vec<[f64; 2]> =
                gaps_m.iter().enumerate().map(|(step, gap_m)| [step as f64 * FRAME_S, *gap_m]).collect();
            plot.line(&points, series);
        }
        let title = format!("Gap of vehicle {} at {}", episode.vehicle_id, self.sites[episode.site]);
        let legend = curves.iter().enumerate().map(|(series, curve)| (curve.0.to_owned(), series)).collect();
        Figure { name: format!("gap-{}", index + 1), svg: plot.finish(&title), title, legend }
    }
}

fn scaled(interval: Interval, factor: f64) -> Interval {
    Interval { mean: factor * interval.mean, low: factor * interval.low, high: factor * interval.high }
}

fn cell(Interval { mean, low, high }: Interval, decimals: usize) -> String {
    format!("{mean:.decimals$} [{low:.decimals$}, {high:.decimals$}]")
}

/// A distribution as an inline table.
fn inline(distribution: &Distribution) -> String {
    match distribution {
        Distribution::Fixed { value } => format!("{{ kind = \"fixed\", value = {value} }}"),
        Distribution::Uniform { min, max } => format!("{{ kind = \"uniform\", min = {min}, max = {max} }}"),
        Distribution::Normal { mean, sd, min, max } => {
            format!("{{ kind = \"normal\", mean = {mean}, sd = {sd}, min = {min}, max = {max} }}")
        }
    }
}

/// How many drivers have which value.
fn histogram(parameter: &Parameter) -> Figure {
    let values = &parameter.drivers;
    let (low, high) = (values[0], values[values.len() - 1].max(values[0] + 1e-6));
    let width = (high - low) / BARS as f64;
    let mut counts = [0.0; BARS];
    for value in values {
        counts[(((value - low) / width) as usize).min(BARS - 1)] += 1.0;
    }
    let outline = counts.iter().enumerate().flat_map(|(bar, count)| {
        let [left, right] = [bar, bar + 1].map(|end| low + width * end as f64);
        [[left, 0.0], [left, *count], [right, *count], [right, 0.0]]
    });
    let outline: Vec<[f64; 2]> = outline.collect();
    let mut plot =
        Plot::new(Axis::over(parameter.key, [low, high]), Axis::over("drivers", counts.into_iter().chain([0.0])));
    plot.line(&outline, 0);
    let title = format!("Drivers by {}", parameter.key);
    Figure { name: parameter.key.replace('_', "-"), svg: plot.finish(&title), title, legend: Vec::new() }
}
