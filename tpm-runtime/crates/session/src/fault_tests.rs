//! Every operation on the files of a campaign fails once: the folder is then as it was before the operation or after it, and the
//! campaign goes on to the result of the unbroken one.

use crate::campaign::Session;
use crate::folder::CampaignFolder;
use crate::model::DeclaredModel;
use std::collections::BTreeMap;
use tpm_experiment::Experiment;
use tpm_report::faults;

#[test]
fn a_campaign_survives_a_fault_of_every_operation() {
    let model = include_str!("../../../../models/mass_spring_drag.tpm");
    let model = DeclaredModel::parse("mass_spring_drag", model).expect("the shipped model is right");
    let file = include_str!("../../../../models/mass_spring_drag.toml");
    let mut experiment = Experiment::parse(file).expect("the shipped file is right");
    // A refinement touches no file.
    for (key, value) in [("schedule.max_runs", "2"), ("schedule.measure_time", "0.0"), ("refine", "none")] {
        experiment.apply_override(key, value).expect("a key of experiments");
    }
    let session = Session::new(model, experiment, None, BTreeMap::new()).expect("a session");
    let place = tempfile::tempdir().expect("a temporary folder");
    let folder = place.path().join("campaign");
    let play = || CampaignFolder::identify(&folder, &session, &mut |_, _, _| true);
    let names = || -> Vec<String> {
        let entries = std::fs::read_dir(&folder).expect("a folder");
        let mut names: Vec<String> =
            entries.map(|entry| entry.expect("readable").file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    };
    let whole = play().expect("nothing fails");
    let kept = names();
    let mut count = 0;
    loop {
        for kills in [false, true] {
            std::fs::remove_dir_all(&folder).expect("a folder");
            faults::after(count, kills);
            let broken = play();
            if !faults::end() {
                assert!(count > 20, "{count} operations");
                return;
            }
            // Whoever is killed leaves temporary files behind; an error does not.
            let left = if broken.is_err() && !kills { names() } else { Vec::new() };
            assert!(left.iter().all(|name| !name.starts_with('.') && kept.contains(name)), "{count}: {left:?}");
            assert!(play().expect("nothing fails any more") == whole, "after a fault of operation {count}");
            assert_eq!(names(), kept, "{count}");
        }
        count += 1;
    }
}
