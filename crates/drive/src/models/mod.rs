//! Pure formulas over gaps and speeds: car following, lane choice, safe distances. They know no world.
