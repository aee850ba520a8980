//! A model trained on recorded head motion serves on another recording: AS16 §6.2 with real motion.

use collision::{MovingSolid, SolidPose};
use hair_bench::full_space::{FullSpace, settle};
use hair_bench::run::replayed_error;
use hair_bench::training_motions::{TrainingMotion, training_motions};
use hair_bench::world::World;
use hair_tests::shared_data;
use io_formats::groom::UniformGroom;
use io_formats::scene::{MotionUse, Scene};
use io_formats::{FrameInfo, FrameSource, MemoryFrames};
use nalgebra::{Isometry3, Vector3};
use skinning_train::{TrainInputs, TrainParams, train};
use std::path::Path;
use strand_sim::StepParams;

const STEP_S: f64 = 0.01;
const STEPS_A_FRAME: usize = 4;
/// Of the error of hair that does not move on its head.
const LEFT_OVER: f64 = 0.5;

/// The recordings and what each is for; seconds of it, and frames skipped (an added T-pose).
const RECORDINGS: [(&str, usize, f64, &str); 3] = [
    ("motion/cmu_01_01.bvh", 1, 1.2, "train"),
    ("motion/bandai_kick_normal_001.bvh", 60, 1.2, "train"),
    ("motion/bandai_bow_happy_001.bvh", 20, 1.2, "held-out"),
];

fn scene() -> Option<Scene> {
    let mut text = "name = \"recorded\"\n[groom]\n\
        generator = { style = \"straight\", strands = 300, length_cm = 20, seed = 3 }\nparticles = 15\nguides = 40\n\
        [train]\nsequences = 0\nheld_out_seconds = 0\n"
        .to_owned();
    for (file, skip, seconds, used_for) in RECORDINGS {
        let path = std::path::absolute(shared_data(file)?).unwrap();
        text += &format!(
            "[[train.recorded]]\nbvh = {path:?}\njoint = \"Head\"\nunit = \"cm\"\nskip_frames = {skip}\nseconds = {seconds}\n\
             used_for = \"{used_for}\"\n"
        );
    }
    Some(Scene::from_toml(&text, Path::new("")).unwrap())
}

fn record(world: &World, rest: &UniformGroom, motions: &[&TrainingMotion]) -> MemoryFrames {
    let mut frames = MemoryFrames::new(rest.n_strands, rest.n_particles);
    let mut positions = Vec::new();
    for (sequence, motion) in motions.iter().enumerate() {
        let mut full = world.full_space(rest, &StepParams::standard()).unwrap();
        for step in 1..=(motion.seconds / STEP_S).round() as usize {
            let at = |step: usize| motion.motion.pose_at(step as f64 * STEP_S);
            let pose = SolidPose { from: at(step - 1), to: at(step) };
            full.step(STEP_S, &at(step), &[MovingSolid { solid: &world.head, pose }]);
            if step.is_multiple_of(STEPS_A_FRAME) {
                full.positions_in_head(&mut positions);
                let info = FrameInfo { sequence: sequence as u32, time_s: step as f64 * STEP_S };
                frames.push(info, &positions).unwrap();
            }
        }
    }
    frames
}

#[test]
fn a_model_of_recorded_motion_serves_on_another_recording() {
    let Some(scene) = scene() else { return };
    let world = World::build(scene, |_| ()).unwrap();
    let motions = training_motions(&world.scene).unwrap();
    let of = |used_for| motions.iter().filter(move |m| m.used_for == used_for).collect::<Vec<_>>();
    assert_eq!((of(MotionUse::Train).len(), of(MotionUse::HeldOut).len()), (2, 1));
    let rest = settle(&world.groom, &world.head, world.material, &StepParams::standard(), |_| ()).unwrap();
    let frames = record(&world, &rest, &of(MotionUse::Train));
    let inputs = TrainInputs {
        rest: &rest,
        groom: &world.groom,
        material: adaptive_runtime::record_of(&world.material),
        provenance: 1,
    };
    let (model, _) = train(&frames, &inputs, &TrainParams::standard(40), &mut |_| {}).unwrap();
    let held_out = record(&world, &rest, &of(MotionUse::HeldOut));
    assert_eq!(held_out.n_frames(), 30);
    let error = replayed_error(&model, &held_out, |_| ()).unwrap();
    assert!(error.all < LEFT_OVER * error.rigid, "{error:?}");
}

#[test]
fn hair_taken_up_again_from_rest_moves_as_hair_made_anew_and_settles_alike_in_lots_of_any_threads() {
    let text = "name = \"again\"\n[groom]\ngenerator = { style = \"straight\", strands = 150, length_cm = 20, seed = 3 }\n\
        particles = 15\nguides = 10\n";
    let world = World::build(Scene::from_toml(text, Path::new("")).unwrap(), |_| ()).unwrap();
    let params = StepParams::standard();
    let settled = || settle(&world.groom, &world.head, world.material, &params, |_| ()).unwrap();
    let rest = settled();
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(rest.points, one.install(settled).points);
    let turned = |k: usize| Isometry3::rotation(Vector3::y() * 0.02 * k as f64);
    let moved = |mut full: FullSpace| {
        for k in 1..=10 {
            let pose = SolidPose { from: turned(k - 1), to: turned(k) };
            full.step(STEP_S, &turned(k), &[MovingSolid { solid: &world.head, pose }]);
        }
        let mut out = Vec::new();
        full.positions(&mut out);
        out
    };
    for rubbing in [false, true] {
        let made = || {
            let full = world.full_space(&rest, &params).unwrap();
            if rubbing { full.rubbing() } else { full }
        };
        let kept = made();
        let first = moved(kept.again());
        assert_eq!(first, moved(kept.again()));
        assert_eq!(first, moved(made()));
    }
}
