//! Training as a whole on a small head of hair made by code: the model is valid, explains the motion it saw, and its
//! bytes depend on its inputs only.
#![allow(clippy::unwrap_used, reason = "test code")]

use std::path::{Path, PathBuf};

use io_formats::guide_transform::Blend;
use io_formats::{FrameInfo, FrameSource, MaterialRecord, MemoryFrames, SkinningModel, StageCache, UniformGroom};
use skinning_train::{Error, TrainInputs, TrainParams, TrainReport, Trainer, train};

const N_STRANDS: usize = 80;
const N_PARTICLES: usize = 10;
const FRAMES_PER_SEQUENCE: usize = 30;
/// Guides must leave less than this share of the motion unexplained.
const UNEXPLAINED: f64 = 0.5;

/// Strands on a patch of the head some 7 cm wide, 9 cm long, whose segments tilt with a phase that drifts over the patch and along the strand, at full
/// length; `amplitude` zero is the rest shape.
fn head(time: f32, amplitude: f32) -> Vec<[f32; 3]> {
    let mut points = Vec::new();
    for s in 0..N_STRANDS {
        let (turn, height) = (s as f32 * 2.399_963, 1.0 - 0.1 * (s as f32 + 0.5) / N_STRANDS as f32);
        let radius = (1.0 - height * height).sqrt();
        let out = [radius * turn.cos(), height, radius * turn.sin()];
        let mut p = out.map(|x| 8.0 * x);
        for i in 0..N_PARTICLES {
            points.push(p);
            let l = i as f32;
            let sway = amplitude * (3.0 * time + 2.0 * out[0] - 0.1 * l).sin();
            let nod = amplitude * (2.0 * time + 2.0 * out[2] - 0.1 * l).cos();
            let along = [out[0] + 0.08 * l * sway, out[1] - 0.1 * l, out[2] + 0.08 * l * nod];
            let length = along.iter().map(|x| x * x).sum::<f32>().sqrt();
            (0..3).for_each(|c| p[c] += along[c] / length);
        }
    }
    points
}

/// RMS distance of the recorded particles from rest: the error of hair that does not move at all.
fn rms_motion_cm() -> f64 {
    let (rest, frames) = (groom().points, frames());
    let mut points = rest.clone();
    let mut sum = 0.0;
    for f in 0..frames.n_frames() {
        frames.read(f, &mut points).expect("the frame is there");
        let squared = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)).sum::<f64>();
        sum += points.iter().zip(&rest).map(squared).sum::<f64>();
    }
    (sum / (frames.n_frames() * rest.len()) as f64).sqrt()
}

fn groom() -> UniformGroom {
    UniformGroom { n_strands: N_STRANDS, n_particles: N_PARTICLES, points: head(0.0, 0.0) }
}

fn frames() -> MemoryFrames {
    let mut frames = MemoryFrames::new(N_STRANDS, N_PARTICLES);
    for sequence in 0..2 {
        for f in 0..FRAMES_PER_SEQUENCE {
            let time_s = f as f64 * 0.04;
            let points = head(time_s as f32 + 10.0 * sequence as f32, 1.0 + sequence as f32);
            frames.push(FrameInfo { sequence, time_s }, &points).expect("the frame has the right number of points");
        }
    }
    frames
}

fn material() -> MaterialRecord {
    MaterialRecord {
        stretch_dyn: 3e5,
        bend: 30.0,
        twist: 15.0,
        stretch_damping: 10.0,
        bend_damping: 0.05,
        twist_damping: 0.05,
        friction: 0.05,
        linear_density_g_per_cm: 5e-5,
        air_drag_per_s: 1.0,
    }
}

fn check(params: &TrainParams) -> (SkinningModel, TrainReport) {
    let groom = groom();
    let inputs = TrainInputs { rest: &groom, groom: &groom, material: material(), provenance: 77 };
    train(&frames(), &inputs, params, &mut |_| {}).expect("the inputs are good")
}

#[test]
fn a_model_trained_from_frames_is_valid_and_explains_them() {
    let (model, report) = check(&TrainParams::standard(12));
    model.validate().expect("train validates");
    assert_eq!(model.n_guides(), 12);
    let motion_cm = rms_motion_cm();
    assert!(report.fit.quadratic_cm < UNEXPLAINED * motion_cm, "{motion_cm} cm: {report:?}");
    assert!(report.fit.free_cm <= report.fit.quadratic_cm, "free weights are the least error possible: {report:?}");
    assert!((3.0..=9.0).contains(&report.mean_eligible), "{report:?}");
    assert!(report.mean_kept_sets >= report.mean_eligible, "single guides are always kept: {report:?}");
    assert!(
        report.lost_energy < 0.01 && report.connected > 0.99 && report.connected > report.connected_paper,
        "{report:?}"
    );
    for (guide, &strand) in model.guide_strands.iter().enumerate() {
        assert_eq!(model.eligible_of(strand as usize), [guide as u16]);
        assert_eq!(model.sets_of(strand as usize).masks, [1]);
    }
}

#[test]
fn the_model_has_the_same_bytes_for_any_number_of_threads() {
    let with_threads = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("threads can be started");
        let (model, mut report) = pool.install(|| check(&TrainParams { rank: 20, ..TrainParams::standard(10) }));
        report.stages.clear();
        (model, report)
    };
    let one = with_threads(1);
    for n in [2, 3] {
        assert!(one == with_threads(n), "{n} threads give another model than one");
    }
}

#[test]
fn progress_ends_complete_in_every_stage_that_is_timed() {
    let groom = groom();
    let inputs = TrainInputs { rest: &groom, groom: &groom, material: material(), provenance: 0 };
    let mut heard: Vec<(&str, u64, u64)> = Vec::new();
    let params = TrainParams { epochs: 2, ..TrainParams::standard(6) };
    let (_, report) = train(&frames(), &inputs, &params, &mut |p| heard.push((p.stage, p.done, p.total)))
        .expect("the inputs are good");
    for (stage, cost) in report.stages {
        let last = heard.iter().rfind(|(s, ..)| *s == stage).expect("every stage reports");
        assert_eq!(last.1, last.2, "{stage}");
        assert!(cost.wall_s >= 0.0 && cost.cpu_s >= 0.0);
    }
}

/// Small blocks, so that a head of few strands has several.
fn in_blocks() -> TrainParams {
    TrainParams { rank: 20, epochs: 3, strands_per_block: 17, ..TrainParams::standard(10) }
}

/// Trains with what `directory` has.
fn resumed(directory: &Path, params: &TrainParams) -> (SkinningModel, TrainReport) {
    let (groom, frames, cache) = (groom(), frames(), StageCache::in_directory(directory).unwrap());
    let inputs = TrainInputs { rest: &groom, groom: &groom, material: material(), provenance: 77 };
    let mut silent = |_| {};
    Trainer::new(&frames, inputs, params, Some(&cache), &mut silent).unwrap().finish().unwrap()
}

fn stage_files(directory: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

#[test]
fn a_training_cut_off_anywhere_ends_with_the_same_model() {
    let params = in_blocks();
    let (whole, whole_report) = check(&params);
    let directory = tempfile::tempdir().unwrap();
    let first = resumed(directory.path(), &params);
    assert!(first.0 == whole, "keeping stages changes nothing");
    let files = stage_files(directory.path());
    assert!(files.iter().all(|f| f.extension().is_some_and(|e| e == "stage")), "no lock stays: {files:?}");
    // A training cut off lacks the stages that were still to come, and maybe some before: every one is taken away in turn,
    // and all that come after it in time.
    let bytes: Vec<Vec<u8>> = files.iter().map(|f| std::fs::read(f).unwrap()).collect();
    for gone in 0..files.len() {
        std::fs::remove_file(&files[gone]).unwrap();
        let (model, report) = resumed(directory.path(), &params);
        assert!(model == whole, "without {:?}", files[gone]);
        assert_eq!(
            TrainReport { stages: Vec::new(), ..report },
            TrainReport { stages: Vec::new(), ..whole_report.clone() }
        );
        for other in (0..files.len()).step_by(1 + gone % 3) {
            let _ = std::fs::remove_file(&files[other]);
        }
        assert!(resumed(directory.path(), &params).0 == whole, "without many from {:?}", files[gone]);
        files.iter().zip(&bytes).for_each(|(file, bytes)| std::fs::write(file, bytes).unwrap());
    }
}

#[test]
fn shards_of_strands_merge_to_the_same_bytes() {
    let params = in_blocks();
    let whole = check(&params).0;
    let (groom, frames) = (groom(), frames());
    let inputs = TrainInputs { rest: &groom, groom: &groom, material: material(), provenance: 77 };
    let directory = tempfile::tempdir().unwrap();
    let cache = StageCache::in_directory(directory.path()).unwrap();
    // Ranges that are no blocks, out of order, two at a time: each block is solved by whose range it begins in.
    std::thread::scope(|scope| {
        for ranges in [[50..N_STRANDS, 0..18], [18..40, 40..50]] {
            let (cache, params, frames) = (&cache, &params, &frames);
            scope.spawn(move || {
                for range in ranges {
                    let mut silent = |_| {};
                    let mut trainer = Trainer::new(frames, inputs, params, Some(cache), &mut silent).unwrap();
                    trainer.solve_weights(range).unwrap();
                }
            });
        }
    });
    let solved = stage_files(directory.path()).len();
    let mut solving = false;
    let mut heard = |p: skinning_train::Progress| solving |= p.stage == "weights" || p.stage == "gram";
    let (merged, _) = Trainer::new(&frames, inputs, &params, Some(&cache), &mut heard).unwrap().finish().unwrap();
    assert!(merged == whole, "shards give another model");
    assert!(!solving, "the shards had solved every block");
    assert_eq!(
        stage_files(directory.path()).len(),
        solved + 4,
        "only scales and the comparison of blends were left to do"
    );
}

#[test]
fn judged_on_the_frames_trained_on_both_errors_are_those_of_training() {
    let params = TrainParams { n_compared: N_STRANDS, ..TrainParams::standard(12) };
    let (groom, frames) = (groom(), frames());
    let inputs = TrainInputs { rest: &groom, groom: &groom, material: material(), provenance: 77 };
    let mut silent = |_| {};
    let judged = Trainer::new(&frames, inputs, &params, None, &mut silent).unwrap().judge(&frames, 1).unwrap();
    assert_eq!((judged.n_guides, judged.n_strands), (12, N_STRANDS - 12));
    assert_eq!(judged.trained_cm, judged.judged_cm);
    let report = check(&params).1;
    // Where the set of all eligible guides was discarded, the one that stands in is nearly as good.
    let ratio = judged.trained_cm / report.fit.quadratic_cm;
    assert!((0.9..1.1).contains(&ratio), "{judged:?}, {:?}", report.fit);
    let mut silent = |_| {};
    let fewer = TrainParams { n_guides: 4, ..params };
    let worse = Trainer::new(&frames, inputs, &fewer, None, &mut silent).unwrap().judge(&frames, 1).unwrap();
    assert!(worse.judged_cm > judged.judged_cm, "a third of the guides: {worse:?}, {judged:?}");
}

#[test]
fn other_parameters_never_take_a_kept_stage_for_theirs() {
    let directory = tempfile::tempdir().unwrap();
    let params = in_blocks();
    resumed(directory.path(), &params);
    let others = [
        TrainParams { seed: 2, ..params.clone() },
        TrainParams { n_guides: 9, ..params.clone() },
        TrainParams { sparsity: 0.05, ..params.clone() },
        TrainParams { max_eligible: 6, ..params.clone() },
        TrainParams { min_weight: 0.05, ..params.clone() },
        TrainParams { distance_percentile: 90.0, ..params.clone() },
        TrainParams { rank: 10, ..params.clone() },
        TrainParams { blend: Blend::Rigid, ..params },
    ];
    for other in others {
        let (kept, fresh) = (resumed(directory.path(), &other), check(&other));
        assert!(kept.0 == fresh.0, "{other:?}");
    }
}

#[test]
fn inputs_of_different_hair_are_refused() {
    let (good, frames) = (groom(), frames());
    let other = UniformGroom {
        n_strands: N_STRANDS - 1,
        n_particles: N_PARTICLES,
        points: good.points[N_PARTICLES..].to_vec(),
    };
    let inputs = TrainInputs { rest: &good, groom: &other, material: material(), provenance: 0 };
    let refused = train(&frames, &inputs, &TrainParams::standard(4), &mut |_| {});
    assert!(matches!(refused, Err(Error::ShapeMismatch { what: "the groom", .. })), "{refused:?}");
}

#[test]
fn a_single_frame_is_no_motion() {
    let (groom, all) = (groom(), frames());
    let mut points = vec![[0.0; 3]; N_STRANDS * N_PARTICLES];
    all.read(0, &mut points).expect("the frame is there");
    let mut one = MemoryFrames::new(N_STRANDS, N_PARTICLES);
    one.push(all.info(0), &points).expect("the frame has the right number of points");
    let inputs = TrainInputs { rest: &groom, groom: &groom, material: material(), provenance: 0 };
    let refused = train(&one, &inputs, &TrainParams::standard(4), &mut |_| {});
    assert!(matches!(refused, Err(Error::TooFewFrames { n_frames: 1, .. })), "{refused:?}");
}
