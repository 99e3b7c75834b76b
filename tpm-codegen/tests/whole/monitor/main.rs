//! The generated monitor of the slider, fed with samples from standard input.

#[allow(dead_code)]
mod slider;

use slider::support::MonitorState;
use slider::{Forces, Monitor, MonitorRules, Motion};

fn main() {
    let values: [f64; 3] = [2.0, 30.0, 8.0];
    let rules = MonitorRules {
        values,
        spread: std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 0.003 * values[i] } else { 0.0 })),
        changes: values.map(|value| 0.1 * value),
        drifts: [0.0, 0.0, 2.5],
        deviations: [0.0],
        sample_time: 0.02,
        block: 50,
        run_in: 20,
        false_alarms: 1e-3,
    };
    assert!(Monitor::new(&rules).is_err());
    let rules = MonitorRules { deviations: [1.0], ..rules };
    let mut monitor = Monitor::new(&rules).expect("good rules");
    let text = std::io::read_to_string(std::io::stdin()).expect("text");
    let mut last = MonitorState::RunIn;
    let mut number = 0;
    for line in text.lines() {
        let values: Vec<f64> = line.split(' ').map(|word| word.parse().expect("a number")).collect();
        let whole = values[4] == 1.0;
        let motion = Motion::from_array(&[values[0], values[1], values[2]]);
        if values[4] == 2.0 {
            monitor.rest(&motion);
            continue;
        }
        let state = monitor.push(&motion, &Forces::from_array([values[3]]), whole);
        match state {
            MonitorState::Moved(moved) => {
                println!("{} 3 {} {:e} {:e}", number / 50, moved.parameter, moved.change, moved.deviation);
                return;
            }
            MonitorState::Unexplained(power) => {
                println!("{} 4 {power:e} 0 0", number / 50);
                return;
            }
            state => assert_eq!(state == MonitorState::LeftOut, !whole || values[1].is_nan()),
        }
        if state != MonitorState::LeftOut {
            last = state;
        }
        number += 1;
    }
    println!("{} {} 0 0 0", number / 50, usize::from(matches!(last, MonitorState::Watching(_))));
}
