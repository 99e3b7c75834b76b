//! What a validation compares, as tracks over time: to be recorded, and looked at beside anything else that was recorded.

use crate::between_stamps::SensorFollowed;
use crate::simulation::{ChannelSimulation, Simulation};
use crate::validate::{RowCourse, Validation};
use tpm_log::Track;

impl Validation {
    /// Over the time of the samples: `measured`, what is `predicted` one sample ahead, the `residual` between the two, and the `free_run` of
    /// every coordinate; `force/ROW`, the applied and the predicted one of every row, where these are compared over time. A model that is
    /// followed between its stamps has no prediction one sample ahead: its residual is that of the free run, and sensors with stamps of their
    /// own have tracks of their own (`measured/x`). Empty where nothing is simulated and rows are compared by harmonics.
    ///
    /// Samples are counted in seconds from the first one that is simulated, stretches one behind the other.
    #[must_use]
    pub fn tracks(&self) -> Vec<Track> {
        let mut tracks = self.simulation.as_ref().map_or_else(Vec::new, Simulation::tracks);
        tracks.extend(self.forces());
        tracks.extend(self.between_stamps.iter().flat_map(|run| followed(&run.sensors)));
        tracks
    }

    /// The forces of the rows over time.
    fn forces(&self) -> impl Iterator<Item = Track> + '_ {
        self.rows.iter().filter_map(|row| {
            let RowCourse::Time(course) = &row.course else { return None };
            let named = |what: &str| labelled(what, row.unit.as_deref());
            Some(Track {
                name: format!("force/{}", row.name),
                time: (0..course.applied.len()).map(|k| course.from + k as f64 * course.apart).collect(),
                signals: vec![
                    (named("applied"), course.applied.clone()),
                    (named("predicted"), course.predicted.clone()),
                ],
            })
        })
    }
}

impl Simulation {
    fn tracks(&self) -> Vec<Track> {
        let samples = self.channels.first().map_or(0, |channel| channel.measured.len());
        let time: Vec<f64> = (0..samples).map(|k| k as f64 * self.sample_time).collect();
        let track = |name: &str, of: &dyn Fn(&ChannelSimulation) -> Vec<f64>| Track {
            name: name.into(),
            time: time.clone(),
            signals: self.channels.iter().map(|own| (labelled(&own.name, own.unit.as_deref()), of(own))).collect(),
        };
        vec![
            track("measured", &|own| own.measured.clone()),
            track("predicted", &|own| own.predicted.clone()),
            track("residual", &|own| less(&own.measured, &own.predicted)),
            track("free_run", &|own| own.simulated.clone()),
        ]
    }
}

/// The tracks of sensors: together where they share their stamps.
fn followed(sensors: &[SensorFollowed]) -> Vec<Track> {
    let shared = sensors.iter().all(|own| own.time == sensors[0].time);
    let groups: Vec<&[SensorFollowed]> = if shared { vec![sensors] } else { sensors.chunks(1).collect() };
    let of = |group: &&[SensorFollowed]| {
        let track = |name: &str, of: &dyn Fn(&SensorFollowed) -> Vec<f64>| Track {
            name: if shared { name.into() } else { format!("{name}/{}", group[0].signal) },
            time: group.first().map_or_else(Vec::new, |own| own.time.clone()),
            signals: group.iter().map(|own| (labelled(&own.signal, own.unit.as_deref()), of(own))).collect(),
        };
        [
            track("measured", &|own| own.measured.clone()),
            track("residual", &|own| less(&own.measured, &own.simulated)),
            track("free_run", &|own| own.simulated.clone()),
        ]
    };
    groups.iter().flat_map(of).collect()
}

fn labelled(name: &str, unit: Option<&str>) -> String {
    unit.map_or_else(|| name.to_owned(), |unit| format!("{name} [{unit}]"))
}

fn less(measured: &[f64], model: &[f64]) -> Vec<f64> {
    measured.iter().zip(model).map(|(measured, model)| measured - model).collect()
}
