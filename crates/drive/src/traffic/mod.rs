//! The world: vehicles, their collisions, and any number of externally driven cars.
