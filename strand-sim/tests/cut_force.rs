//! The force through a cut of a strand that hangs still is the weight below the cut.
#![allow(clippy::unwrap_used, reason = "test code")]

use nalgebra::{Isometry3, Vector3};
use strand_sim::{Material, StepInput, StepParams, StepWorkspace, StrandSystem};

#[test]
fn a_strand_that_hangs_still_carries_the_weight_below_every_cut() {
    /// Of the strand's weight: half a segment's mass lies on either side of a particle, and perturbed ones beside.
    const A_SEGMENT: f64 = 0.051;
    const N: usize = 25;
    let (sin, cos) = 0.3_f64.sin_cos();
    let straight = (0..N).map(|i| Vector3::new(sin, -cos, 0.0) * (0.8 * i as f64));
    let curly = (0..N).map(|i| {
        let turn = 0.9 * i as f64;
        Vector3::new(5.0 + 0.6 * turn.cos(), -0.7 * i as f64, 0.6 * turn.sin())
    });
    let points: Vec<_> = straight.chain(curly).collect();
    let material = Material { air_drag_per_s: 4.0, ..Material::straight() };
    let system = StrandSystem::new(&points, N, material).unwrap();
    let mut state = system.rest_state(&Isometry3::identity());
    let mut workspace = StepWorkspace::default();
    for _ in 0..1500 {
        let input = StepInput::still(0.01, Isometry3::identity());
        system.step(&mut state, &input, &StepParams::standard(), &mut workspace);
    }
    for strand in 0..2 {
        let length: f64 = points[strand * N..][..N].windows(2).map(|w| (w[1] - w[0]).norm()).sum();
        let weight = material.linear_density_g_per_cm * length * 981.0;
        for segment in 3..N - 1 {
            let force = system.cut_force(&state, strand, segment);
            let below = weight * (1.0 - segment as f64 / (N - 1) as f64);
            let off = (force - Vector3::y() * below).norm() / weight;
            assert!(off < A_SEGMENT, "strand {strand}, segment {segment}: {force} for {below}");
        }
    }
}
