//! Scenes and distributions over scenes, from text.
