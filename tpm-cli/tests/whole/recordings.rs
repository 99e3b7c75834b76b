//! Logs as people record them, of machines whose parameters are known: each is right within its deviations.

use crate::support::tpm_in;
use serde_json::Value;
use std::f64::consts::TAU;
use std::fmt::Write as _;

/// A drive with viscous and dry friction.
const DRIVE: &str = "model Drive {
    coordinate x [m];
    input u [V];
    parameter ks [V], kv [V*s/m], ka [V*s^2/m];
    ka*ddot(x) + kv*dot(x) + ks*sign(dot(x)) = u;
}";
const OF_DRIVE: [f64; 3] = [0.2, 2.5, 0.4];

/// The drive's position and velocity.
#[derive(Clone, Copy, Default)]
struct Drive {
    x: f64,
    v: f64,
}

impl Drive {
    /// Moves for a while under a voltage that is held: exactly, from one change of the direction to the next.
    fn advance(&mut self, u: f64, mut left: f64) {
        let [ks, kv, ka] = OF_DRIVE;
        while left > 0.0 && !(self.v == 0.0 && u.abs() <= ks) {
            let direction = if self.v == 0.0 { u.signum() } else { self.v.signum() };
            let last = (u - direction * ks) / kv;
            let turns = if last * direction < 0.0 { ka / kv * ((self.v - last) / -last).ln() } else { f64::INFINITY };
            let time = turns.min(left);
            let share = (-time * kv / ka).exp();
            self.x += last * time + (self.v - last) * ka / kv * (1.0 - share);
            self.v = if turns <= left { 0.0 } else { last + (self.v - last) * share };
            left -= time;
        }
    }
}

/// Normal noise of deviation one, the same at every run.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = 0x9e37_79b9_7f4a_7c15 ^ (seed << 32);
    move || {
        // The sum of twelve uniform numbers.
        let uniform = (0..12).map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1_u64 << 53) as f64
        });
        uniform.sum::<f64>() - 6.0
    }
}

/// What `tpm identify` says of a log: exit code, JSON, messages.
fn identify(model: &str, log: &str, options: &[&str]) -> (Option<i32>, Value, String) {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("machine.tpm"), model).expect("written");
    std::fs::write(folder.path().join("log.csv"), log).expect("written");
    let command = ["identify", "machine.tpm", "--log", "log.csv", "--json"];
    let output = tpm_in(folder.path(), &[&command, options].concat());
    let json = serde_json::from_slice(&output.stdout).unwrap_or_default();
    (output.status.code(), json, String::from_utf8_lossy(&output.stderr).into_owned())
}

/// Asserts that every parameter is within three stated deviations of the truth, and that these are so small a share of it.
fn assert_right((code, json, said): &(Option<i32>, Value, String), truth: &[f64], largest: f64) {
    assert_eq!(*code, Some(0), "{said}");
    for (own, truth) in json["parameters"].as_array().expect("parameters").iter().zip(truth) {
        let (value, std) = (own["value"].as_f64().expect("a value"), own["std"].as_f64().expect("a deviation"));
        assert!((value - truth).abs() < 3.0 * std && std < largest * truth, "{own}\n{said}");
    }
}

#[test]
fn counts_of_a_turn_begin_at_an_offset_that_is_an_expression() {
    // A spring whose rest is the middle of the encoder's range.
    let model = "model Spring {
        coordinate phi [rad];
        input u [N*m];
        parameter J [kg*m^2], d [N*m*s/rad], k [N*m/rad];
        J*ddot(phi) + d*dot(phi) + k*phi = u;
    }";
    let truth = [2e-3, 4e-3, 0.15];
    let (mut phi, mut rate) = (0.2_f64, 0.0);
    let mut noise = noise(1);
    let mut text = String::from("t_s,counts,u\n");
    for k in 0..3000 {
        let u = 0.12 * (0.7 * (k / 60) as f64 + (k / 60 * k / 60) as f64).sin();
        let counts = ((phi + TAU / 2.0) / (TAU / 4096.0) + 0.5 * noise()).round();
        let _ = writeln!(text, "{},{counts},{u:.6}", 0.005 * f64::from(k));
        for _ in 0..500 {
            rate += 1e-5 * (u - truth[1] * rate - truth[2] * phi) / truth[0];
            phi += 1e-5 * rate;
        }
    }
    let options = ["--map", "phi=counts", "--scale", "phi=2*pi/4096", "--offset", "phi=-pi", "--hold", "zoh"];
    assert_right(&identify(model, &text, &options), &truth, 0.01);
}

#[test]
fn a_motor_that_is_switched_is_told_between_uneven_stamps() {
    let mut noise = noise(2);
    let mut text = String::from("t_s,x,u\n");
    let (mut drive, mut ms) = (Drive::default(), 0_i32);
    for k in 0..900 {
        // Full forward, full back and nothing, for times of their own.
        let u = [6.0, -6.0, 0.0, -6.0, 6.0, 6.0, 0.0][(k / 23 + k / 57) % 7];
        let _ = writeln!(text, "{:.3},{:.4},{u}", 1e-3 * f64::from(ms), drive.x + 2e-4 * noise());
        let step = 11 + (2.5 * noise()).round().clamp(-6.0, 6.0) as i32;
        drive.advance(u, 1e-3 * f64::from(step));
        ms += step;
    }
    assert_right(&identify(DRIVE, &text, &["--hold", "zoh"]), &OF_DRIVE, 0.05);
}

#[test]
fn topics_that_are_written_when_they_change_are_late_by_what_is_found() {
    // The position is stamped 0.7 ms later than the voltage, and was read at the same instant.
    let mut noise = noise(3);
    let mut text = String::from("Timestamp,/Drive/Volts,/Drive/Position\n");
    let mut drive = Drive::default();
    let (mut last_u, mut last_x) = (f64::NAN, String::new());
    for k in 0..900 {
        let t = 0.02 * f64::from(k);
        let u = match k / 150 {
            0 => t,
            1 => 0.0,
            2 => 6.0 - t,
            3 => 6.0,
            4 => -6.5,
            _ => 1.5,
        };
        let x = format!("{:.4}", drive.x + 5e-5 * noise());
        if u != last_u {
            let _ = writeln!(text, "{:.6},{u:.4},", t + 7e-4);
        }
        if x != last_x {
            let _ = writeln!(text, "{:.6},,{x}", t + 14e-4);
        }
        (last_u, last_x) = (u, x);
        drive.advance(u, 0.02);
    }
    let options = ["--map", "u=/Drive/Volts", "--map", "x=/Drive/Position", "--hold", "zoh"];
    let found = identify(DRIVE, &text, &options);
    assert_right(&found, &OF_DRIVE, 0.02);
    let sensor = &found.1["log"]["sensors"][0];
    let (late, std) = (sensor["late"].as_f64().expect("found"), sensor["late_std"].as_f64().expect("found"));
    assert!((late - 7e-4).abs() < 3.0 * std && std < 2e-4, "{sensor}");
}
