//! Lane-change paths: candidates, features and choice.
