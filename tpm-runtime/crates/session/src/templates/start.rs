//! Templates without a log: a model with a motion, and an experiment on its simulated machine.

use crate::templates::catalogue::Template;
use crate::templates::quantity::Quantity;
use std::fmt::Write as _;
use tpm_codegen::source::Source;

/// The experiment, in which words in braces stand for what differs from one template to the next.
const EXPERIMENT: &str = include_str!("models/experiment.toml");

impl Template {
    /// The texts of a model of this name in a file of the name `stem`, and of its experiment, for who has no log yet.
    #[must_use]
    pub fn without_log(&self, name: &str, stem: &str) -> (String, String) {
        let units: Vec<&str> = self.coordinates.iter().map(|(_, quantity)| quantity.unit(*quantity)).collect();
        let turns = self.coordinates.first().is_some_and(|(_, quantity)| *quantity == Quantity::Angle);
        let input = if turns { Quantity::Torque } else { Quantity::Force };
        let input = input.unit(input);
        let first = self.coordinates.first().map_or("", |(name, _)| *name);
        let model = self.filled(name, &units, input, false);
        let frequency = if self.start.values.iter().any(|(name, _)| *name == "w") { "w0" } else { "w" };
        let free = if self.coordinates.len() > 1 { "; what hangs on it moves as it must" } else { "" };
        let pattern = format!(
            "\n    // A motion for experiments; a log needs none. `tpm explain stages` says where its amplitude and frequency are chosen.\n    \
             pattern {{\n        amplitude lambda [{}];\n        frequency {frequency} [rad/s];\n        \
             {first} = lambda*(cos({frequency}*t) - 1/9*cos(3*{frequency}*t)); // starts and ends at rest{free}\n    }}\n}}\n",
            units.first().unwrap_or(&"1")
        );
        let model = model.trim_end().trim_end_matches('}').trim_end().to_owned() + "\n" + &pattern;
        let laid_out = tpm_codegen::language::format(&Source::new(stem, &*model));
        let model = laid_out.unwrap_or(model);
        let start = &self.start;
        let list = |value: &dyn Fn(usize, f64) -> f64| -> Vec<String> {
            start.values.iter().enumerate().map(|(at, (name, own))| format!("{name} = {:?}", value(at, *own))).collect()
        };
        let mut sensors = String::new();
        for ((name, _), unit) in self.coordinates.iter().zip(&units) {
            let _ = write!(
                sensors,
                "[plant.sensors.{name}]\nnoise = 1e-4                      # standard deviation of white noise, {unit}\n\n"
            );
        }
        let experiment = [
            ("{model}", stem.to_owned()),
            ("{values}", list(&|_, own| own).join(", ")),
            ("{sensors}\n", sensors),
            ("{prior}", list(&|at, own| if at == 0 || units.len() > 1 { own / 2.0 } else { 0.0 }).join("\n")),
            ("{first}", first.to_owned()),
            ("{kp}", format!("{:?}", start.kp)),
            ("{kd}", format!("{:?}", start.kd)),
            ("{most}", format!("{:?}", start.most)),
            ("{input}", input.to_owned()),
            ("{tracking}", format!("{first} = {:?}", start.off)),
            ("{frequency}", frequency.to_owned()),
            ("{unit}", (*units.first().unwrap_or(&"1")).to_owned()),
            ("{slow}", format!("{:?}", start.amplitude)),
            ("{fast}", format!("{:?}", 2.0 * start.amplitude)),
        ];
        let text = experiment.into_iter().fold(EXPERIMENT.to_owned(), |text, (word, value)| text.replace(word, &value));
        (model, text)
    }
}
