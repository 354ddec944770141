//! Pure formulas over gaps and speeds: car following, lane choice, safe distances. They know no world.

pub mod car_following;
pub mod idm;
pub mod mobil;
pub mod rss;
pub mod safe_distance;
