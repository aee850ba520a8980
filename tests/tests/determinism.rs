//! Same inputs, any number of threads: the same bytes, in simulation, training and at runtime.

use adaptive_runtime::{Runtime, RuntimeParams, StepInput, record_of};
use hair_tests::models::Row;
use hair_tests::scenes::{Tuft, ball, mixed_strands, rod, sliding};
use hair_tests::with_threads;
use io_formats::{FrameInfo, MemoryFrames, UniformGroom};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use skinning_train::{TrainInputs, TrainParams, train};
use strand_sim::{Material, StepParams};

const THREADS: [usize; 3] = [1, 2, 8];

fn same_for_all<T: PartialEq + std::fmt::Debug + Send>(run: impl Fn() -> T + Sync) -> T {
    let one = with_threads(THREADS[0], &run);
    for n in &THREADS[1..] {
        assert!(with_threads(*n, &run) == one, "{n} threads differ from {}", THREADS[0]);
    }
    one
}

#[test]
fn strands_in_contact_step_to_the_same_bytes_for_any_thread_count() {
    let solid = ball(3.0);
    let points = mixed_strands(60);
    let contacts = same_for_all(|| {
        let mut tuft = Tuft::new(&points, Material::straight(), StepParams::standard());
        let mut contacts = 0;
        for k in 0..40 {
            let at = |k: usize| Vector3::new(-10.0 + k as f64, -12.0, 1.0);
            contacts += tuft.step(Isometry3::identity(), &[sliding(&solid, at(k), at(k + 1))]).contacts;
        }
        let bits: Vec<u64> =
            tuft.positions().iter().flat_map(|p| [p.x.to_bits(), p.y.to_bits(), p.z.to_bits()]).collect();
        (contacts, bits)
    })
    .0;
    assert!(contacts > 0, "solid and hair were to meet");
}

#[test]
fn a_run_ends_in_the_same_state_for_any_thread_count() {
    let (_, changes, corrected) = same_for_all(|| {
        let start = Translation3::new(-4.0, -9.0, 0.2).into();
        let mut params = RuntimeParams::adaptive();
        // Sets are to be left, wherever that helps at all.
        params.assign.leave_gain_cm = 0.0;
        let mut runtime = Runtime::new(
            Row::parted().model(),
            params,
            Isometry3::identity(),
            None,
            vec![rod(0.15, 5.0, 0.2)],
            &[start],
        )
        .unwrap();
        let (mut changes, mut corrected) = (0, 0);
        for k in 1..=80 {
            let t = 0.01 * f64::from(k);
            let head = Isometry3::rotation(Vector3::y() * 0.3 * (6.0 * t).sin());
            let pose = [Isometry3::from(Translation3::new(-4.0 + 10.0 * t, -9.0, 0.2))];
            let report = runtime.step(&StepInput { dt: 0.01, world_from_head: head, world_from_solids: &pose });
            changes += report.set_changes;
            corrected += report.corrected_strands;
        }
        (runtime.state_hash(), changes, corrected)
    });
    assert!(changes > 0 && corrected > 0, "the run was to use every stage");
}

#[test]
fn the_state_hash_sees_a_hairs_breadth() {
    let hash = |shift: f64| {
        let pose = Translation3::new(0.0, -9.0, 0.1).into();
        let mut runtime = Runtime::new(
            Row::parted().model(),
            RuntimeParams::adaptive(),
            Isometry3::identity(),
            None,
            vec![rod(0.15, 5.0, 0.2)],
            &[pose],
        )
        .unwrap();
        let head = Isometry3::from_parts(Translation3::new(shift, 0.0, 0.0), UnitQuaternion::identity());
        runtime.step(&StepInput { dt: 0.01, world_from_head: head, world_from_solids: &[pose] });
        runtime.state_hash()
    };
    assert_eq!(hash(0.0), hash(0.0));
    assert_ne!(hash(0.0), hash(1e-3));
}

#[test]
fn training_gives_the_same_model_for_any_thread_count_and_the_runtime_takes_it() {
    let (n_strands, n) = (40, 13);
    let shape = |t: f32| -> Vec<[f32; 3]> {
        (0..n_strands * n)
            .map(|k| {
                let (s, i) = ((k / n) as f32, (k % n) as f32);
                let sway = 0.02 * i * i * (t + 0.15 * s).sin();
                [0.5 * s + sway, -i, 0.01 * i * i * (0.7 * t - 0.2 * s).cos()]
            })
            .collect()
    };
    let rest = UniformGroom { n_strands, n_particles: n, points: shape(0.0) };
    let mut frames = MemoryFrames::new(n_strands, n);
    for f in 0..40 {
        frames.push(FrameInfo { sequence: 0, time_s: 0.05 * f64::from(f) }, &shape(0.25 * f as f32)).unwrap();
    }
    let inputs = TrainInputs { rest: &rest, groom: &rest, material: record_of(&Material::straight()), provenance: 7 };
    let model = same_for_all(|| train(&frames, &inputs, &TrainParams::standard(8), &mut |_| {}).unwrap().0);
    assert_eq!(model.n_guides(), 8);
    let mut runtime = Runtime::new(model, RuntimeParams::adaptive(), Isometry3::identity(), None, vec![], &[]).unwrap();
    let guides = runtime.guides_in_head().to_vec();
    runtime.replay(&guides, &Isometry3::identity());
    assert_eq!(runtime.positions(), rest.points, "hair at rest is reproduced exactly");
}
