//! Reports of full, minimal and hostile data.

mod sample;

use super::*;
use crate::metrics::Interval;
use sample::{full, pooled, result, set};

const HOSTILE: &str = "</script><script>alert(1)</script><img src=x onerror=\"alert(2)\">'{{body}}<!--";

/// The text between the first `from` and the next `to`.
fn between<'a>(text: &'a str, from: &str, to: &str) -> &'a str {
    let (_, rest) = text.split_once(from).unwrap();
    rest.split_once(to).unwrap().0
}

fn episode(page: &str) -> serde_json::Value {
    serde_json::from_str(between(page, "type=\"application/json\">", "</script>")).unwrap()
}

/// No drawing has an attribute with a number that is none.
fn assert_drawings_are_numeric(page: &str) {
    for svg in page.split("<svg").skip(1).map(|s| s.split_once("</svg>").unwrap().0) {
        for attribute in svg.split('"').skip(1).step_by(2) {
            let mut words = attribute.split([' ', ',', 'M', 'L', 'H', 'V', 'h', 'v', '-']);
            assert!(words.all(|word| word != "NaN" && word != "inf"), "{attribute}");
        }
    }
}

#[test]
fn a_full_report_has_its_sections_in_order() {
    let page = render(&full());
    let headings: Vec<&str> = page.split("<h2>").skip(1).map(|s| s.split_once("</h2>").unwrap().0).collect();
    let expected = [
        "Read with this in mind",
        "Watch an episode",
        "Results",
        "Learning",
        "Learned human reward",
        "Where the time went",
        "Run it again",
    ];
    assert_eq!(headings, expected);
    assert_drawings_are_numeric(&page);
    assert_eq!(page, render(&full()), "equal data give equal bytes");
}

#[test]
fn the_page_loads_nothing() {
    for page in [render(&full()), render(&pooled()), render(&ReportData::default())] {
        assert!(page.contains("default-src 'none'"));
        for word in ["http:", "https:", "//", "@import", "url(", " src=", "import("] {
            let scripts_and_styles = page.replace("// ", "");
            assert!(!scripts_and_styles.contains(word), "{word}");
        }
    }
}

#[test]
fn tags_are_balanced() {
    let page = render(&full()) + &render(&pooled());
    for tag in
        ["section", "div", "svg", "table", "tr", "td", "th", "ul", "li", "details", "figure", "script", "p", "span"]
    {
        let opened = page.matches(&format!("<{tag} ")).count() + page.matches(&format!("<{tag}>")).count();
        assert_eq!(opened, page.matches(&format!("</{tag}>")).count(), "{tag}");
    }
}

#[test]
fn the_episode_parses_back() {
    let data = full();
    let (page, trace) = (render(&data), data.trace.unwrap());
    let episode = episode(&page);
    let frames: usize = trace.ticks.iter().map(|t| t.frames.len()).sum();
    assert_eq!(episode["frames"].as_array().unwrap().len(), frames);
    assert_eq!(episode["ticks"].as_array().unwrap().len(), trace.ticks.len());
    let first = &trace.ticks[0].frames[0];
    assert_eq!(episode["frames"][0]["vehicles"].as_array().unwrap().len(), 4 * first.vehicles.len());
    assert!((episode["frames"][0]["s"].as_f64().unwrap() - first.ego.s_m).abs() <= 0.005);
    assert_eq!(episode["ticks"][0]["words"], "Accelerate");
    assert_eq!(episode["ticks"][0]["weights"], "q1 = 0.025");
}

#[test]
fn lane_changes_are_found_with_their_sides() {
    let changes = player::lane_changes(&full().trace.unwrap());
    let sides: Vec<bool> = changes.iter().map(|c| c.left).collect();
    assert_eq!(sides, [true, false]);
    for change in changes {
        assert!((3.0..6.0).contains(&(change.end_s - change.start_s)));
    }
}

#[test]
fn an_empty_report_is_a_page() {
    let page = render(&ReportData { title: "Empty".into(), ..ReportData::default() });
    assert!(page.contains("<h1>Empty</h1>") && !page.contains("<section>") && !page.contains("<script"));
    let mut data = full();
    data.trace.as_mut().unwrap().ticks.clear();
    data.curves[0].1.clear();
    data.irl.as_mut().unwrap().features.clear();
    let page = render(&data);
    assert!(!page.contains("id=\"player\""));
    assert_drawings_are_numeric(&page);
}

/// The full data with names and numbers that try to break out.
fn hostile(odd: f64) -> ReportData {
    let mut data = full();
    data.title = HOSTILE.into();
    data.summary = vec![HOSTILE.into()];
    data.statements.push(HOSTILE.into());
    data.sets[0].results[0].policy = HOSTILE.into();
    data.curves[0].0 = HOSTILE.into();
    data.time_shares[0].0 = HOSTILE.into();
    data.seeds[0] = (HOSTILE.into(), HOSTILE.into());
    data.config_toml = HOSTILE.into();
    let irl = data.irl.as_mut().unwrap();
    irl.source = HOSTILE.into();
    irl.features[0].name = HOSTILE.into();
    let trace = data.trace.as_mut().unwrap();
    trace.header.policy = HOSTILE.into();
    trace.ticks[0].action_name = HOSTILE.into();
    irl.features[0].weight = odd;
    irl.features[1].interval = Some(Interval { mean: 0.0, low: odd, high: odd });
    trace.header.ego_length_m = odd;
    trace.ticks[0].frames[0].ego.d_m = odd;
    trace.ticks[2].frames[0].ego.speed_mps = odd;
    trace.ticks[2].frames[1].time_s = odd;
    trace.ticks[2].frames[2].vehicles[0].ahead_m = odd;
    trace.ticks[16].path.as_mut().unwrap().duration_s = odd;
    trace.ticks[16].candidates[0].reward = odd;
    data.sets[0].results[0].reward_per_tick = Interval { mean: odd, low: odd, high: odd };
    data.sets[0].results[1].collisions_per_episode.high = odd;
    data.curves[0].1[3].reward_per_tick = odd;
    data.time_shares[0].1 = odd;
    data
}

#[test]
fn names_stay_text() {
    let page = render(&hostile(1.0));
    for tag in ["<script>alert", "<img", "<!--"] {
        assert!(!page.contains(tag), "{tag}");
    }
    assert_eq!(page.matches("<script").count(), 2);
    assert_eq!(page.matches("</script>").count(), 2);
    assert!(episode(&page)["ticks"][0]["words"].as_str().unwrap().ends_with("<!--"));
}

#[test]
fn numbers_that_are_none_break_nothing() {
    for odd in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN_POSITIVE] {
        let page = render(&hostile(odd));
        assert_drawings_are_numeric(&page);
        episode(&page);
    }
}

#[test]
fn only_a_clear_best_is_marked() {
    let interval = |low: f64, high: f64| Interval { mean: f64::midpoint(low, high), low, high };
    let clear = [interval(1.0, 2.0), interval(2.5, 3.0), interval(0.0, 0.5)];
    assert_eq!(table::clear_best(&clear, true), Some(1));
    assert_eq!(table::clear_best(&clear, false), Some(2));
    assert_eq!(table::clear_best(&[interval(1.0, 2.6), interval(2.5, 3.0)], true), None);
    assert_eq!(table::clear_best(&clear[..1], true), None);
    let odd = [interval(f64::NAN, f64::NAN), interval(2.5, 3.0)];
    assert_eq!(table::clear_best(&odd, true), None);
}

#[test]
fn a_reading_is_written_from_the_results_and_says_what_is_open() {
    let mut data =
        ReportData { sets: vec![set(vec![result("a", 18.0, 0.1), result("b", 18.1, 0.1)])], ..ReportData::default() };
    assert!(render(&data).contains("the order of these is not settled"));
    data.sets[0].results[0] = result("a", 15.0, 0.1);
    assert!(render(&data).contains("lies above all others"));
}

#[test]
fn pooled_runs_have_their_methods_before_each_run() {
    let page = render(&pooled());
    assert_drawings_are_numeric(&page);
    let places = ["Methods over training seeds", "Performance profile", "dqn − rule:best-lane", "Chance that a seed"];
    let places = places.map(|text| page.find(text).unwrap());
    assert!(places.is_sorted() && places[3] < page.find("Each run and rule alone").unwrap());
    // Collisions stand beside the reward wherever a method's reward stands.
    assert!(page.contains("collisions, % of episodes") && page.contains("per 1 000 km"));
}

#[test]
fn sets_of_scenarios_have_sections_of_their_own() {
    let mut data = full();
    data.sets.push(data.sets[0].clone());
    data.sets[0].name = "a <b>".into();
    data.sets[1].name = "c".into();
    let page = render(&data);
    assert!(page.contains("Results in the scenarios of a &lt;b&gt;") && page.contains("Results in the scenarios of c"));
}

#[test]
fn odd_methods_break_nothing() {
    for odd in [f64::NAN, f64::INFINITY, f64::MAX] {
        let mut data = pooled();
        let method = &mut data.sets[0].methods[0];
        method.name = HOSTILE.into();
        method.reward_per_tick = Interval { mean: odd, low: odd, high: odd };
        method.profile[1] = (odd, Interval { mean: odd, low: odd, high: odd });
        data.sets[0].differences[0].other = HOSTILE.into();
        data.sets[0].improvement[0][1].high = odd;
        let page = render(&data);
        assert_drawings_are_numeric(&page);
        assert!(!page.contains("<script>alert") && !page.contains("<img"));
    }
}
