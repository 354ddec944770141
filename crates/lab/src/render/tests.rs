use std::sync::Arc;

use lanecraft_drive::env::{Config, Env};
use lanecraft_drive::road::{LaneIndex, Road, RoadConfig, Side};
use lanecraft_drive::scenario::VehicleKind;

use super::*;

const SIZE_PX: (u32, u32) = (600, 150);
/// Pixels for each meter in a picture of 600 px: 100 m are seen.
const SCALE: f64 = 6.0;

fn body(s_m: f64, d_m: f64, speed_mps: f64) -> Body {
    Body { s_m, d_m, heading_rad: 0.0, speed_mps, length_m: 4.8, width_m: 1.9, kind: VehicleKind::Car, signal: None }
}

/// The ego in the middle of three lanes of a ring, 10 m past its seam, among these.
fn view(vehicles: Vec<Body>) -> View {
    View {
        road: Arc::new(Road::new(RoadConfig::default()).expect("valid")),
        time_s: 12.5,
        ego: body(10.0, 3.75, 25.0),
        target_lane: LaneIndex(1),
        vehicles,
        path: Vec::new(),
        collision: None,
        note: "keep lane".to_owned(),
    }
}

fn picture(view: &View) -> Vec<u8> {
    rgb(view, SIZE_PX.0, SIZE_PX.1).expect("an allowed size")
}

/// Number of pixels of a color, and their mean place (0, 0) if there are none.
fn patch(picture: &[u8], color: [u8; 3]) -> (f64, f64, f64) {
    let (mut count, mut x, mut y) = (0.0, 0.0, 0.0);
    for (index, _) in picture.chunks(3).enumerate().filter(|(_, pixel)| *pixel == color) {
        count += 1.0;
        x += f64::from(index as u32 % SIZE_PX.0);
        y += f64::from(index as u32 / SIZE_PX.0);
    }
    let total = f64::max(count, 1.0);
    (count, x / total, y / total)
}

#[test]
fn the_ego_is_at_its_place_and_as_large_as_it_is() {
    let (count, x, y) = patch(&picture(&view(Vec::new())), EGO_COLOR);
    // Windows, outline and cut corners take less than half of the body.
    let area = 4.8 * 1.9 * SCALE * SCALE;
    assert!(count > 0.5 * area && count < area, "{count} of {area} px");
    // Its windows are not symmetric; the middle lane is in the middle below the strip of 16 px.
    assert!((x - 180.0).abs() < 4.0 && (y - 83.0).abs() < 1.5, "at {x}, {y}");
}

#[test]
fn as_many_pixels_as_vehicles() {
    let one = patch(&picture(&view(vec![body(40.0, 0.0, 0.0)])), SPEED_COLORS[0]).0;
    assert!(one > 100.0);
    let standing = [40.0, 20.0, 60.0, 30.0].map(|s_m| body(s_m, if s_m > 50.0 { 7.5 } else { 0.0 }, 0.0));
    let four = patch(&picture(&view(standing.to_vec())), SPEED_COLORS[0]).0;
    // Edges fall on other parts of pixels.
    assert!((four / one - 4.0).abs() < 0.2, "{four} of {one} px each");
}

#[test]
fn up_is_left_and_right_is_ahead() {
    let (_, _, ego_y) = patch(&picture(&view(Vec::new())), EGO_COLOR);
    let (_, x, y) = patch(&picture(&view(vec![body(40.0, 7.5, 0.0)])), SPEED_COLORS[0]);
    assert!((x - (180.0 + 30.0 * SCALE)).abs() < 4.0, "30 m ahead at {x}");
    assert!((ego_y - y - 3.75 * SCALE).abs() < 1.0, "a lane to the left at {y}");
}

#[test]
fn a_ring_closes_in_the_picture() {
    let behind = patch(&picture(&view(vec![body(1000.0 - 5.0, 0.0, 0.0)])), SPEED_COLORS[0]);
    assert!((behind.1 - (180.0 - 15.0 * SCALE)).abs() < 4.0, "15 m behind, beyond the seam, at {}", behind.1);
    let text = ansi(&view(vec![body(1000.0 - 5.0, 0.0, 0.0)]), 80).expect("allowed");
    let row = plain(text.lines().nth(5).expect("the right lane"));
    assert_eq!(row.find("=>"), Some(17), "15 m are six columns, and the ego begins in column 23:\n{row}");
}

#[test]
fn equal_views_give_equal_bytes() {
    let env = Env::new(&Arc::new(Config::default()), 3).expect("valid");
    let (first, second) = (View::of(&env), View::of(&env.clone()));
    assert_eq!(first, second);
    assert_eq!(first.vehicles.len(), env.world().len());
    assert_eq!(picture(&first), picture(&second));
    assert_eq!(ansi(&first, 80), ansi(&second, 80));
}

#[test]
fn sizes_out_of_range_are_refused() {
    let view = view(Vec::new());
    for (width_px, height_px) in [(0, 0), (127, 150), (600, 63), (4097, 150), (600, 2161), (u32::MAX, u32::MAX)] {
        assert_eq!(rgb(&view, width_px, height_px), Err(RenderError::Size { width_px, height_px }));
    }
    for (width_px, height_px) in [SIZE_MIN_PX, (SIZE_MIN_PX.0, 400), (1200, 300)] {
        assert_eq!(rgb(&view, width_px, height_px).expect("allowed").len(), (3 * width_px * height_px) as usize);
    }
    for columns in [0, 19, 401, usize::MAX] {
        assert_eq!(ansi(&view, columns), Err(RenderError::Columns { columns }));
    }
}

#[test]
fn a_view_of_nonsense_is_drawn_without_a_panic() {
    for value in [f64::NAN, f64::INFINITY, -1e300, 1e9] {
        let mut view = view(vec![Body { heading_rad: value, length_m: value, ..body(value, value, value) }]);
        view.path = vec![(value, value), (0.0, value)];
        view.target_lane = LaneIndex(200);
        view.collision = Some(7);
        view.note = "naïve ☃".repeat(100);
        let _ = picture(&view);
        let _ = ansi(&view, 80).expect("allowed");
        view.ego = body(value, value, value);
        let _ = picture(&view);
        let _ = ansi(&view, 80).expect("allowed");
    }
}

#[test]
fn signals_paths_and_collisions_show() {
    let plain = picture(&view(Vec::new()));
    let mut changing = view(vec![body(14.0, 3.75, 0.0)]);
    changing.ego.signal = Some(Side::Left);
    changing.path = (0..=20).map(|k| (10.0 + 3.0 * f64::from(k), 3.75 + 0.1875 * f64::from(k))).collect();
    changing.target_lane = LaneIndex(2);
    changing.collision = Some(0);
    let shown = picture(&changing);
    for color in [picture::PATH, picture::SIGNAL, picture::CRASH] {
        assert_eq!(patch(&plain, color).0, 0.0, "{color:?}");
        assert!(patch(&shown, color).0 > 20.0, "{color:?}");
    }
}

/// The text without its escape sequences.
fn plain(text: &str) -> String {
    let mut parts = text.split('\x1b');
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |text, part| text + part.split_once('m').map_or("", |(_, rest)| rest))
}

#[test]
fn the_terminal_shows_lanes_as_rows() {
    let mut view = view(vec![body(60.0, 7.5, 20.0)]);
    view.vehicles.push(Body { length_m: 12.0, width_m: 2.5, kind: VehicleKind::Truck, ..body(85.0, 0.0, 20.0) });
    let text = ansi(&view, 80).expect("allowed");
    let rows: Vec<String> = text.lines().map(plain).collect();
    assert_eq!(rows.len(), 8, "three lanes, four lines, the status");
    assert!(rows[..7].iter().all(|row| row.chars().count() == 80), "{text}");
    assert_eq!([rows[1].find("=>"), rows[3].find("=>"), rows[5].find("####>")], [Some(43), Some(23), Some(51)]);
    assert!(rows[0].chars().all(|c| c == '─') && rows[2].contains('-') && rows[7].contains("25.0 m/s"), "{text}");
}
