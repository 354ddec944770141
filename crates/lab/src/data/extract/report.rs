//! What was found, as tables and figures.

use super::{Extraction, LaneChange, Quality};
use crate::data::read::median;
use crate::data::traffic::FRAME_S;
use crate::report::svg::{Axis, Plot};
use crate::studies::{Figure, StudyReport, Table};

/// The qualities with what they mean.
const QUALITIES: [(Quality, &str); 3] = [
    (Quality::A, "A: complete, 3 s on both sides"),
    (Quality::B, "B: complete"),
    (Quality::C, "C: cut off near the center of a lane"),
];
/// Width of a bar of the histogram, s.
const BAR_S: f64 = 0.5;
/// Bars of the histogram, over all durations that are allowed.
const BARS: usize = 25;
/// Time shown on either side of the crossing, s.
const SHOWN_S: f64 = 6.0;

impl Extraction {
    /// Tables and figures.
    pub fn report(&self) -> StudyReport {
        StudyReport {
            name: "lane-changes",
            title: "Lane changes of recorded traffic".to_owned(),
            summary: self.summary(),
            tables: vec![self.change_table(), self.skip_table(), self.site_table()],
            figures: vec![self.profiles(), self.durations()],
        }
    }

    fn summary(&self) -> String {
        let vehicles: usize = self.sites.iter().map(|site| site.tracks.len()).sum();
        format!(
            "{} lane changes of {vehicles} vehicles at {} sites. A lane change begins and ends where the lateral speed stays below 0.10 m/s for \
             more than 0.8 s.",
            self.changes.len(),
            self.sites.len()
        )
    }

    fn of(&self, quality: Quality) -> impl Iterator<Item = &LaneChange> {
        self.changes.iter().filter(move |change| change.quality == quality)
    }

    fn change_table(&self) -> Table {
        let head = ["quality", "lane changes", "median duration, s", "median shift, m", "median speed, m/s"];
        let mut table = Table::new("changes", "Lane changes", &head);
        for (quality, name) in QUALITIES {
            let median_of = |of: fn(&LaneChange) -> f64| {
                let values: Vec<f64> = self.of(quality).map(of).collect();
                if values.is_empty() { String::new() } else { format!("{:.2}", median(values)) }
            };
            let medians = [LaneChange::duration_s, LaneChange::shift_m, LaneChange::mean_speed_mps].map(median_of);
            let row = [name.to_owned(), self.of(quality).count().to_string()].into_iter().chain(medians);
            table.rows.push(row.collect());
        }
        table
    }

    fn skip_table(&self) -> Table {
        let mut table = Table::new("left-out", "Left out", &["what", "how many"]);
        table.rows = self.skips.iter().map(|(skip, count)| vec![skip.text().to_owned(), count.to_string()]).collect();
        table
    }

    fn site_table(&self) -> Table {
        let head = ["site", "vehicles", "lanes", "lane changes", "centers of the lanes, m"];
        let mut table = Table::new("sites", "Sites", &head);
        for (index, site) in self.sites.iter().enumerate() {
            let centers: Vec<String> = site.lane_centers_m.iter().map(|center| format!("{center:.2}")).collect();
            let changes = self.changes.iter().filter(|change| change.site == index).count();
            let counts = [site.tracks.len(), site.lane_centers_m.len(), changes].map(|count| count.to_string());
            table.rows.push([site.name.clone()].into_iter().chain(counts).chain([centers.join(" ")]).collect());
        }
        table
    }

    /// Way to the new lane over time; the better qualities lie on top.
    fn profiles(&self) -> Figure {
        let ways_m = self.changes.iter().flat_map(|change| self.profile(change)).map(|[_, way_m]| way_m);
        let across = Axis::over("way past the line, m", ways_m.chain([-2.0, 2.0]));
        let mut plot = Plot::new(Axis::exactly("time since the crossing, s", -SHOWN_S, SHOWN_S), across);
        for (series, (quality, _)) in QUALITIES.into_iter().enumerate().rev() {
            self.of(quality).for_each(|change| plot.line(&self.profile(change), series));
        }
        let title = "Lateral profiles".to_owned();
        let legend = QUALITIES.iter().enumerate().map(|(series, (_, name))| ((*name).to_owned(), series)).collect();
        Figure { name: "profiles".into(), svg: plot.finish(&title), title, legend }
    }

    /// The maneuver as time since the crossing and distance from the line, positive in the new lane.
    fn profile(&self, change: &LaneChange) -> Vec<[f64; 2]> {
        let centers_m = &self.sites[change.site].lane_centers_m;
        let [from_m, to_m] = [change.lane_from, change.lane_to].map(|lane| centers_m[lane as usize - 1]);
        let (line_m, sign) = (f64::midpoint(from_m, to_m), (to_m - from_m).signum());
        let time_s = |frame: i32| f64::from(frame - change.crossing) * FRAME_S;
        let shown = change.maneuver().iter().filter(|point| time_s(point.frame).abs() <= SHOWN_S);
        shown.map(|point| [time_s(point.frame), sign * (point.d_m - line_m)]).collect()
    }

    fn durations(&self) -> Figure {
        let mut counts = [0.0; BARS];
        for change in &self.changes {
            // Durations are whole tenths, so the slack only undoes rounding.
            counts[((change.duration_s() / BAR_S + 1e-6) as usize).min(BARS - 1)] += 1.0;
        }
        let corners = |(bar, count): (usize, &f64)| {
            let [left, right] = [bar, bar + 1].map(|end| end as f64 * BAR_S);
            [[left, *count], [right, *count]]
        };
        let outline: Vec<[f64; 2]> = counts.iter().enumerate().flat_map(corners).collect();
        let time = Axis::exactly("duration, s", 0.0, BARS as f64 * BAR_S);
        let mut plot = Plot::new(time, Axis::over("lane changes", counts.into_iter().chain([0.0])));
        plot.line(&outline, 0);
        let title = "Durations".to_owned();
        Figure { name: "durations".into(), svg: plot.finish(&title), title, legend: Vec::new() }
    }
}
