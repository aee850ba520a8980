//! The scene of real files (tests/scenes/sintel.toml): someone's groom, head, comb and recorded motion become a world.
//!
//! What a run of it looks like is for `cargo xtask run-scene`; here is what must hold before the first step.

use hair_bench::world::World;
use hair_tests::shared_data;
use io_formats::scene::Scene;
use nalgebra::Isometry3;
use std::path::Path;

/// Strands of the groom file: none of them is lost on the way in.
const N_STRANDS: usize = 11_400;

fn world() -> Option<World> {
    for file in [
        "grooms/sintel_hair_16pts.tfx",
        "solids/sintel_collider.obj",
        "solids/comb.stl",
        "motion/bandai_bow_happy_001.bvh",
    ] {
        shared_data(file)?;
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/sintel.toml");
    Some(World::build(Scene::read(&path).unwrap(), |_| ()).unwrap())
}

#[test]
fn real_files_become_a_world_and_no_strand_is_lost() {
    let Some(world) = world() else { return };
    assert_eq!((world.groom.n_strands, world.dropped_strands), (N_STRANDS, 0));
    assert_eq!(world.world_from_head(0.0), Isometry3::identity(), "hair starts where the groom is");

    assert!(world.groom.points.iter().flatten().all(|x| x.is_finite()));
    assert!(world.solids[0].half_thickness_cm < 0.15, "the comb's teeth are about a millimetre thick");
    let turned = (0..=world.n_steps()).map(|k| world.world_from_head(k as f64 * world.scene.step_s).rotation.angle());
    assert!(turned.fold(0.0, f64::max) > 0.3, "the head bows");
}
