//! What passes between stages as a file is what passes in memory.

use adaptive_runtime::{Runtime, RuntimeParams, StepInput};
use hair_tests::models::Row;
use hair_tests::scenes::rod;
use hair_tests::shared_data;
use io_formats::{LengthUnit, SkinningModel, read_groom, read_hair, write_hair};
use nalgebra::{Isometry3, Translation3};

fn run(model: SkinningModel) -> u64 {
    let pose = Translation3::new(0.0, -9.0, 0.1).into();
    let mut runtime =
        Runtime::new(model, RuntimeParams::adaptive(), Isometry3::identity(), None, vec![rod(0.2, 4.0, 0.2)], &[pose])
            .unwrap();
    for _ in 0..10 {
        runtime.step(&StepInput { dt: 0.01, world_from_head: Isometry3::identity(), world_from_solids: &[pose] });
    }
    runtime.state_hash()
}

#[test]
fn a_model_that_went_through_a_file_moves_hair_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("row.skin");
    let model = Row::parted().model();
    model.save(&path).unwrap();
    let read = SkinningModel::load(&path).unwrap();
    assert_eq!(read, model);
    assert_eq!(run(read), run(model));
}

#[test]
fn a_model_file_with_any_one_byte_changed_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("row.skin");
    Row::of_three_guides().model().save(&path).unwrap();
    let whole = std::fs::read(&path).unwrap();
    // A prime stride visits header, counts, floats and the end.
    for at in (0..whole.len()).step_by(97).chain([whole.len() - 1]) {
        let mut damaged = whole.clone();
        damaged[at] ^= 0x10;
        std::fs::write(&path, &damaged).unwrap();
        assert!(SkinningModel::load(&path).is_err(), "byte {at} of {}", whole.len());
    }
    for cut in [0, 7, whole.len() / 2, whole.len() - 1] {
        std::fs::write(&path, &whole[..cut]).unwrap();
        assert!(SkinningModel::load(&path).is_err(), "cut at {cut} of {}", whole.len());
    }
}

#[test]
fn real_hair_survives_a_round_trip_through_hair_files() {
    let Some(path) = shared_data("grooms/sintel_hair_16pts.tfx") else { return };
    let groom = read_groom(&path, LengthUnit::M).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("sintel.hair");
    write_hair(&copy, &groom, LengthUnit::Cm).unwrap();
    assert_eq!(read_hair(&copy, LengthUnit::Cm).unwrap(), groom);
}
