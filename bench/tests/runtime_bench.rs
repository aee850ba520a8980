//! Laws of what `bench runtime` measures, on a small head trained on the spot.
#![allow(clippy::unwrap_used, reason = "test code")]

use adaptive_runtime::{RuntimeParams, record_of};
use collision::{MovingSolid, SolidPose};
use hair_bench::full_space::{FullSpace, settle};
use hair_bench::head_motion::{HeadMotionParams, random_head_motion};
use hair_bench::runtime_bench::cost::{Reads, copy_cost, time_loop};
use hair_bench::runtime_bench::quality::{full_run, measure, rows};
use hair_bench::runtime_bench::{Figure, Subject, situations};
use hair_bench::world::World;
use io_formats::scene::Scene;
use io_formats::skinning_model::SkinningModel;
use io_formats::{FrameInfo, MemoryFrames};
use skinning_train::{TrainInputs, TrainParams, train};
use std::path::Path;
use std::sync::LazyLock;
use strand_sim::StepParams;

const STRANDS: usize = 240;
const GUIDES: usize = 12;

/// A comb that goes through the hair at the back within a third of a second, and is gone for good.
const SCENE: &str = r#"
name = "small"
seconds = 0.5
fps = 20
[groom]
generator = { style = "straight", strands = 240, length_cm = 20, seed = 1 }
particles = 13
guides = 12
[[solid]]
name = "comb"
shape = { kind = "comb", teeth = 20, pitch_cm = 0.8, tooth_radius_cm = 0.15, tooth_length_cm = 4.5, spine_radius_cm = 0.35 }
keys = [
  { t = 0.0, translate_cm = [0, -6, -16], rotate_deg = [0, 180, 0] },
  { t = 0.1, translate_cm = [0, -6, -12], rotate_deg = [0, 180, 0] },
  { t = 0.3, translate_cm = [0, -12, -12], rotate_deg = [0, 180, 0] },
  { t = 0.35, translate_cm = [0, -12, -30], rotate_deg = [0, 180, 0] },
]
"#;

struct Head {
    world: World,
    model: SkinningModel,
}

static HEAD: LazyLock<Head> = LazyLock::new(|| {
    let world = World::build(Scene::from_toml(SCENE, Path::new("")).unwrap(), |_| {}).unwrap();
    let params = StepParams::standard();
    let rest = settle(&world.groom, &world.head, world.material, &params, |_| {}).unwrap();
    let motion = random_head_motion(3, 0, 0.4, &HeadMotionParams::lively());
    let mut full = FullSpace::new(&world.groom, &rest, &world.head, world.material, &params).unwrap();
    let mut frames = MemoryFrames::new(STRANDS, world.groom.n_particles);
    let mut positions = Vec::new();
    for step in 1..=40 {
        let now = f64::from(step) * 0.01;
        let pose = SolidPose { from: motion.pose_at(now - 0.01), to: motion.pose_at(now) };
        full.step(0.01, &motion.pose_at(now), &[MovingSolid { solid: &world.head, pose }]);
        if step % 4 == 0 {
            full.positions_in_head(&mut positions);
            frames.push(FrameInfo { sequence: 0, time_s: now }, &positions).unwrap();
        }
    }
    let inputs = TrainInputs { rest: &rest, groom: &world.groom, material: record_of(&world.material), provenance: 0 };
    let (model, _) = train(&frames, &inputs, &TrainParams::standard(GUIDES), &mut |_| {}).unwrap();
    Head { world, model }
});

fn subject() -> Subject<'static> {
    Subject { world: &HEAD.world, model: &HEAD.model, params: RuntimeParams::adaptive() }
}

fn value(rows: &[Figure], name: &str) -> f64 {
    rows.iter().find(|r| r.name == name).unwrap_or_else(|| panic!("no figure {name}")).value.unwrap()
}

#[test]
fn a_loop_has_as_many_steps_and_reads_as_its_time_asks_for_and_begins_again() {
    let loops = |from, to, reads| time_loop(&subject(), from, to, reads, |_| {}).unwrap();
    let once = loops(0.0, 0.5, Reads::Pictures);
    assert_eq!((once.steps.len(), once.times(true).len()), (50, 10));
    assert!((once.sim_s - 0.5).abs() < 1e-9 && once.cpu_s() > 0.0);
    let twice = loops(0.0, 1.0, Reads::Pictures);
    assert_eq!((twice.steps.len(), twice.times(true).len()), (100, 20));
    let part = loops(0.2, 0.3, Reads::All);
    assert_eq!((part.steps.len(), part.times(false).len()), (10, 0));
    assert_eq!(once.nonfinite + twice.nonfinite + part.nonfinite, 0);
    assert!(copy_cost(&HEAD.model) > 0.0);
}

#[test]
fn the_first_strands_are_measured_as_they_are_among_all() {
    let subject = subject();
    let all = full_run(&subject, STRANDS, 0, |_| {}).unwrap();
    let few = full_run(&subject, 100, 0, |_| {}).unwrap();
    assert!(all.reach.iter().any(|r| r.len() > 20), "the comb reaches hair");
    for (all, few) in all.reach.iter().zip(&few.reach) {
        let first: Vec<u32> = all.iter().copied().filter(|&s| s < 100).collect();
        assert_eq!(&first, few);
    }
    let quality = measure(&subject, &few, |_| {}).unwrap();
    assert_eq!((quality.measured.n_strands, quality.measured.nonfinite, quality.quarantined), (100, 0, 0));
    let mut near: Vec<u32> = few.reach.iter().flatten().copied().collect();
    near.sort_unstable();
    near.dedup();
    assert_eq!(quality.measured.near_strands, near.len());
}

#[test]
fn hair_that_nothing_touches_is_where_full_space_has_it() {
    // Half a per cent of the length: a head at rest differs by what settling leaves and weights round.
    const AT_REST_PCT: f64 = 0.5;
    let mut scene = HEAD.world.scene.clone();
    scene.solids.clear();
    scene.seconds = 0.2;
    let still = HEAD.world.staged(scene, None).unwrap();
    let subject = Subject { world: &still, ..subject() };
    let against = full_run(&subject, STRANDS, 60, |_| {}).unwrap();
    let quality = measure(&subject, &against, |_| {}).unwrap();
    assert_eq!((quality.measured.near_strands, against.frames.len()), (0, 4));
    let error = quality.error.unwrap().all;
    assert!(error < AT_REST_PCT, "{error} %");
}

#[test]
fn every_figure_of_a_swept_solid_is_finite_and_has_its_name() {
    let subject = subject();
    let against = full_run(&subject, STRANDS, 60, |_| {}).unwrap();
    let quality = measure(&subject, &against, |_| {}).unwrap();
    let rows = rows("comb", &subject, &against, &quality);
    for name in ["near_strands_inside_pct_comb", "passed_through_pct_comb", "standoff_over_full_cm_comb"] {
        assert!(value(&rows, name).is_finite(), "{name}");
    }
    assert!(rows.iter().all(|r| r.value.is_some_and(f64::is_finite)), "{rows:?}");
    // Full space follows every strand: it keeps out of the comb better than hair that does not know it.
    assert!(against.measured.near_strands_inside_pct < 50.0, "{}", against.measured.near_strands_inside_pct);
}

#[test]
fn guides_are_watched_until_they_are_back_and_rounds_until_the_end() {
    let subject = subject();
    let rows = situations::recovery(&subject, STRANDS, |_| {}).unwrap();
    assert!(value(&rows, "guides_least") <= value(&rows, "guides_before"));
    assert!(value(&rows, "seconds_after_solid_left") > 0.1);
    let rows = situations::endurance(&subject, 1.0, |_| {}).unwrap();
    assert_eq!(value(&rows, "endurance_nonfinite") + value(&rows, "endurance_quarantined"), 0.0);
}
