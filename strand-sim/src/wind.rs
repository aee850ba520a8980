//! Moving air as a field over space and time, and its drag on hair.
//!
//! Drag on a thin fibre is proportional to the velocity of the air relative to it, and half as strong along the fibre as
//! across (slender-body theory of slow flow). It is part of the implicit matrix, so no wind is too strong for the step.

use nalgebra::Vector3;
use std::fmt::Debug;

/// Drag along the hair as a share of the drag across it.
pub(crate) const ALONG_OVER_ACROSS: f64 = 0.5;

/// Velocity of the air.
pub trait WindField: Sync + Debug {
    /// Velocity (cm/s) at a point of the world (cm) and a time (s).
    fn velocity(&self, point: Vector3<f64>, time_s: f64) -> Vector3<f64>;
}

/// The same wind everywhere and always.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UniformWind(
    /// Velocity, cm/s.
    pub Vector3<f64>,
);

impl WindField for UniformWind {
    fn velocity(&self, _: Vector3<f64>, _: f64) -> Vector3<f64> {
        self.0
    }
}

/// A mean wind with gusts that travel with it: three plane waves whose turning part is across their own direction, so
/// that the field has no sources.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GustyWind {
    /// Mean velocity, cm/s.
    pub mean: Vector3<f64>,
    /// Largest velocity that one wave adds, cm/s.
    pub gust: f64,
    /// Length of the longest wave, cm; the others are shorter by the golden ratio each.
    pub wavelength_cm: f64,
}

impl WindField for GustyWind {
    fn velocity(&self, point: Vector3<f64>, time_s: f64) -> Vector3<f64> {
        // Directions apart from each other and from the axes, so that no plane of the scene is favoured.
        const WAVES: [([f64; 3], [f64; 3]); 3] = [
            ([0.36, 0.48, 0.8], [0.8, -0.6, 0.0]),
            ([-0.8, 0.36, 0.48], [0.0, 0.8, -0.6]),
            ([0.48, -0.8, 0.36], [-0.6, 0.0, 0.8]),
        ];
        const GOLDEN: f64 = 1.618_033_988_749_895;
        let carried = point - self.mean * time_s;
        let mut velocity = self.mean;
        let mut number = std::f64::consts::TAU / self.wavelength_cm;
        for (direction, across) in WAVES {
            let phase = number * Vector3::from(direction).dot(&carried) + number.sqrt() * time_s;
            velocity += Vector3::from(across) * (self.gust * phase.sin());
            number *= GOLDEN;
        }
        velocity
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gusts_have_no_sources() {
        /// Central differences at this spacing (cm) err by the field's third derivative times its square.
        const STEP_CM: f64 = 1e-3;
        const DIVERGENCE_PER_S: f64 = 1e-5;
        let wind = GustyWind { mean: Vector3::new(200.0, 0.0, 30.0), gust: 100.0, wavelength_cm: 20.0 };
        for k in 0..50 {
            let (x, t) = (Vector3::new(0.7 * f64::from(k), 3.0, -0.4 * f64::from(k)), 0.05 * f64::from(k));
            let divergence: f64 = (0..3)
                .map(|c| {
                    let mut e = Vector3::zeros();
                    e[c] = STEP_CM;
                    (wind.velocity(x + e, t)[c] - wind.velocity(x - e, t)[c]) / (2.0 * STEP_CM)
                })
                .sum();
            assert!(divergence.abs() < DIVERGENCE_PER_S, "{divergence} at {x:?}");
        }
    }
}
