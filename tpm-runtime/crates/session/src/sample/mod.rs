//! The sample inside a program, for whoever has no log yet: a slide with friction, and the machine that is simulated in its place.

/// Name and text of the model's file.
pub const SAMPLE_MODEL: (&str, &str) = ("slide.tpm", include_str!("slide.tpm"));

/// Name and text of the experiment's file, whose first run is the sample's log.
pub const SAMPLE_EXPERIMENT: (&str, &str) = ("slide.toml", include_str!("slide.toml"));
