//! Curls stretched and let go, dropped, and hung (MS08 Fig. 10d, 11).
//!
//! A curl is a helix about the vertical, its particles spaced so that no three are in line: the rig without perturbed
//! particles. What a curl keeps of itself under its weight is a matter of the material: see `Material::curly`.

use super::shape::{arc_length, largest_strain, rms_distance, tortuosity};
use super::{Film, Frame, Stage, ease, straight_strand};
use crate::error::Error;
use nalgebra::{Isometry3, Translation3, Vector3};
use serde::Serialize;
use std::f64::consts::TAU;
use strand_sim::{Drive, Material, StepParams};

/// Step, s.
const DT: f64 = 0.01;

/// Air drag at which a curl comes to rest within some seconds, 1/s.
const DRAG_PER_S: f64 = 3.0;

/// A helix downwards from a root.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Curl {
    /// Particles.
    pub n_particles: usize,
    /// Length of hair, cm.
    pub length_cm: f64,
    /// Radius, cm.
    pub radius_cm: f64,
    /// Height of a turn, cm.
    pub pitch_cm: f64,
}

impl Curl {
    /// 25 cm of hair in a curl of 0.75 cm, as of loosely curled hair: 40 % of its length is in its height.
    #[must_use]
    pub fn standard() -> Self {
        Self { n_particles: 50, length_cm: 25.0, radius_cm: 0.75, pitch_cm: 2.0 }
    }

    /// Its points from the origin, cm.
    #[must_use]
    pub fn points(&self) -> Vec<Vector3<f64>> {
        let turn_cm = (TAU * self.radius_cm).hypot(self.pitch_cm);
        (0..self.n_particles)
            .map(|i| {
                let turns = self.length_cm / turn_cm * i as f64 / (self.n_particles - 1) as f64;
                let (sin, cos) = (TAU * turns).sin_cos();
                Vector3::new(self.radius_cm * (cos - 1.0), -self.pitch_cm * turns, self.radius_cm * sin)
            })
            .collect()
    }
}

/// What a stretched curl did.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StretchFigures {
    /// Height when pulled over height at rest.
    pub stretched: f64,
    /// Greatest rise of the tip above where it came to rest, as a share of the pull.
    pub overshoot: f64,
    /// RMS distance from the shape before the pull a second after the release, as a share of the hair's length.
    pub error_after_1_s: f64,
    /// The same four seconds after.
    pub error_after_4_s: f64,
    /// Largest strain of any segment at any time.
    pub largest_strain: f64,
}

/// Lets a curl hang, pulls its tip down to `times` its height and lets go.
///
/// # Errors
/// A curl that cannot be simulated.
pub fn stretch_and_release(curl: &Curl, material: Material, times: f64) -> Result<(StretchFigures, Film), Error> {
    const SETTLE_STEPS: usize = 600;
    const PULL_STEPS: usize = 150;
    const FREE_STEPS: usize = 400;
    let n = curl.n_particles;
    let rest = curl.points();
    let material = Material { air_drag_per_s: DRAG_PER_S, ..material };
    let mut stage = Stage::new(&rest, n, material, StepParams::standard(), None)?;
    for _ in 0..SETTLE_STEPS {
        stage.rest(DT, &[]);
    }
    let hung = stage.positions();
    stage.shoot();
    let height = -hung[n - 1].y;
    // The tip is held by its last two particles, as they hang.
    let held = |down: f64| {
        let offset = hung[n - 1] - rest[n - 1];
        Isometry3::from(Translation3::from(offset - Vector3::y() * down))
    };
    let pull = (times - 1.0) * height;
    let mut largest: f64 = 0.0;
    for step in 0..PULL_STEPS {
        let at = |k: usize| held(pull * ease(k as f64, 0.9 * PULL_STEPS as f64));
        let drive = Drive { strand: 0, particles: (n - 1, n - 1), before: at(step), after: at(step + 1) };
        stage.rest(DT, &[drive]);
        largest = largest.max(largest_strain(&stage.positions(), &rest, n));
        if (step + 1) % (PULL_STEPS / 2) == 0 {
            stage.shoot();
        }
    }
    let stretched = -stage.positions()[n - 1].y / height;
    let mut figures = StretchFigures {
        stretched,
        overshoot: 0.0,
        error_after_1_s: f64::NAN,
        error_after_4_s: f64::NAN,
        largest_strain: 0.0,
    };
    for step in 0..FREE_STEPS {
        stage.rest(DT, &[]);
        let now = stage.positions();
        largest = largest.max(largest_strain(&now, &rest, n));
        figures.overshoot = figures.overshoot.max((now[n - 1].y + height) / pull);
        if step + 1 == 100 {
            figures.error_after_1_s = rms_distance(&now, &hung) / curl.length_cm;
        }
        if [4, 9, 19, 99, FREE_STEPS - 1].contains(&step) {
            stage.shoot();
        }
    }
    figures.error_after_4_s = rms_distance(&stage.positions(), &hung) / curl.length_cm;
    figures.largest_strain = largest;
    Ok((figures, stage.into_film()))
}

/// What a dropped curl did.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DropFigures {
    /// Bending and twisting constants over the material's own.
    pub stiffness: Vec<f64>,
    /// Height when hanging still over height at rest, for each.
    pub extension: Vec<f64>,
    /// Largest of the same while falling, for each.
    pub greatest_extension: Vec<f64>,
    /// Share of what the curl takes off the hair's length that its own weight takes away, for each.
    pub curl_lost: Vec<f64>,
}

/// Drops one curl, unstressed as drawn, for each factor of stiffness; strands of the film stand side by side.
///
/// # Errors
/// A curl that cannot be simulated.
pub fn drop_curls(curl: &Curl, material: Material, factors: &[f64]) -> Result<(DropFigures, Film), Error> {
    const STEPS: usize = 800;
    let rest = curl.points();
    let n = curl.n_particles;
    let height = -rest[n - 1].y;
    let mut figures = DropFigures {
        stiffness: factors.to_vec(),
        extension: Vec::new(),
        greatest_extension: Vec::new(),
        curl_lost: Vec::new(),
    };
    let mut film = Film::new(n);
    for (k, &factor) in factors.iter().enumerate() {
        let material = scaled(Material { air_drag_per_s: DRAG_PER_S, ..material }, factor);
        let mut stage = Stage::new(&rest, n, material, StepParams::standard(), None)?;
        let mut greatest = 1.0_f64;
        stage.shoot();
        for step in 0..STEPS {
            stage.rest(DT, &[]);
            greatest = greatest.max(-stage.positions()[n - 1].y / height);
            if [9, 19, 39, STEPS - 1].contains(&step) {
                stage.shoot();
            }
        }
        let hung = -stage.positions()[n - 1].y;
        figures.extension.push(hung / height);
        figures.greatest_extension.push(greatest);
        figures.curl_lost.push((hung - height) / (arc_length(&rest) - height));
        side_by_side(&mut film, stage.into_film(), Vector3::x() * (4.0 * k as f64));
    }
    Ok((figures, film))
}

/// What hanging strands of every waviness keep of it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct WavinessFigures {
    /// Arc length over the distance of the ends as drawn: straight, slightly wavy, evenly wavy, curly.
    pub drawn: [f64; 4],
    /// The same when hanging still.
    pub hanging: [f64; 4],
    /// Share of (tortuosity - 1) kept; one for the straight strand, which has none to lose.
    pub kept: [f64; 4],
}

/// Hangs a straight, a slightly wavy, an evenly wavy and a curly strand.
///
/// # Errors
/// Strands that cannot be simulated.
pub fn hang_wavy(material: Material) -> Result<(WavinessFigures, Film), Error> {
    const STEPS: usize = 800;
    let (n, length) = (50, 25.0);
    // A wave whose size differs along the strand, and one of a single size.
    let uneven = wave(n, length, |s| 0.15 + 0.35 * (0.5 - 0.5 * (TAU * s / 11.0).cos()));
    let strands = [
        straight_strand(Vector3::zeros(), -Vector3::y(), length, n),
        uneven,
        wave(n, length, |_| 0.5),
        Curl::standard().points(),
    ];
    let mut figures = WavinessFigures { drawn: [0.0; 4], hanging: [0.0; 4], kept: [1.0; 4] };
    let mut film = Film::new(n);
    for (k, rest) in strands.iter().enumerate() {
        let material = Material { air_drag_per_s: DRAG_PER_S, ..material };
        let mut stage = Stage::new(rest, n, material, StepParams::standard(), None)?;
        stage.shoot();
        for step in 0..STEPS {
            stage.rest(DT, &[]);
            if [9, 19, 39, STEPS - 1].contains(&step) {
                stage.shoot();
            }
        }
        let hanging = stage.positions();
        figures.drawn[k] = tortuosity(rest);
        figures.hanging[k] = tortuosity(&hanging);
        if k > 0 {
            figures.kept[k] = (figures.hanging[k] - 1.0) / (figures.drawn[k] - 1.0);
        }
        side_by_side(&mut film, stage.into_film(), Vector3::x() * (4.0 * k as f64));
    }
    Ok((figures, film))
}

/// The material with bending and twisting (altitude springs with them) scaled.
#[must_use]
pub fn scaled(material: Material, factor: f64) -> Material {
    Material {
        bend_dyn: factor * material.bend_dyn,
        twist_dyn: factor * material.twist_dyn,
        altitude_dyn: factor * material.altitude_dyn,
        ..material
    }
}

/// A plane wave of 4 cm about the vertical with an amplitude along its axis, cut into equal segments.
fn wave(n: usize, length_cm: f64, amplitude_cm: impl Fn(f64) -> f64) -> Vec<Vector3<f64>> {
    let at = |s: f64| Vector3::new(amplitude_cm(s) * (TAU * s / 4.0).sin(), -s, 0.0);
    let spacing = length_cm / (n - 1) as f64;
    let mut points = vec![at(0.0)];
    let (mut s, mut way) = (0.0, 0.0);
    let mut before = at(0.0);
    while points.len() < n {
        s += 1e-3;
        let here = at(s);
        way += (here - before).norm();
        before = here;
        if way >= spacing {
            way -= spacing;
            points.push(here);
        }
    }
    points
}

/// Adds the strands of a film to those of another, moved aside, frame by frame.
fn side_by_side(film: &mut Film, other: Film, aside: Vector3<f64>) {
    for (k, frame) in other.frames.into_iter().enumerate() {
        if film.frames.len() <= k {
            film.frames.push(Frame { time_s: frame.time_s, positions: Vec::new() });
        }
        film.frames[k].positions.extend(frame.positions.iter().map(|p| p + aside));
    }
}
