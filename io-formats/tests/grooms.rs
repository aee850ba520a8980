//! Laws of grooms and of the readers of groom files, on hand-made input.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "test code")]

mod common;

use std::path::Path;

use common::{data_bytes, hair_bytes, hair_header, push_floats, random_strand, tfx_bytes};
use io_formats::groom::{arc_length, negate_axes};
use io_formats::hair::parse_hair;
use io_formats::tfx::parse_tfx;
use io_formats::usc::parse_data;
use io_formats::{Error, Groom, LengthUnit, read_hair, write_hair};

/// Points are stored as `f32`; at coordinates of tens of centimetres that is a few millionths.
const ROUND_OFF_CM: f64 = 2e-5;
/// Relative round-off of sums of `f32` distances.
const ROUND_OFF: f64 = 1e-5;

fn here() -> &'static Path {
    Path::new("test")
}

#[test]
fn roots_and_tips_are_kept_exactly_by_resampling() {
    let strands: Vec<_> = (1..40).map(|s| random_strand(s, 2 + s as usize % 17)).collect();
    let uniform = Groom::from_strands(&strands).resample(25).unwrap();
    for (i, source) in strands.iter().enumerate() {
        assert_eq!(uniform.strand(i)[0], source[0]);
        assert_eq!(uniform.strand(i)[24], source[source.len() - 1]);
    }
}

#[test]
fn resampled_particles_lie_on_the_polyline_at_equal_arc_length() {
    for seed in 1..30 {
        let source = random_strand(seed, 9);
        let total = arc_length(&source);
        let uniform = Groom::from_strands(std::slice::from_ref(&source)).resample(12).unwrap();
        for (i, p) in uniform.strand(0).iter().enumerate() {
            // Walk the source to the same arc length, plainly.
            let mut left = total * i as f64 / 11.0;
            let mut expected = source[8].map(f64::from);
            for w in source.windows(2) {
                let length = arc_length(w);
                if left <= length {
                    expected = std::array::from_fn(|k| {
                        f64::from(w[0][k]) + (f64::from(w[1][k]) - f64::from(w[0][k])) * left / length
                    });
                    break;
                }
                left -= length;
            }
            for k in 0..3 {
                assert!((f64::from(p[k]) - expected[k]).abs() < ROUND_OFF_CM, "seed {seed}, particle {i}");
            }
        }
    }
}

#[test]
fn a_uniform_strand_is_resampled_to_itself() {
    let line: Vec<_> = (0..25).map(|i| [0.3 * i as f32, 1.0, -0.4 * i as f32]).collect();
    let groom = Groom::from_strands(&[line]);
    let once = groom.resample(25).unwrap();
    assert_eq!(once.to_groom(), groom);
}

#[test]
fn a_straight_strand_has_equal_segments_after_resampling() {
    let line: Vec<_> = [0.0, 0.1, 0.11, 3.0, 7.5, 20.0_f32].map(|z| [0.0, 0.0, z]).to_vec();
    let uniform = Groom::from_strands(&[line]).resample(9).unwrap();
    for w in uniform.strand(0).windows(2) {
        assert!((arc_length(w) - 2.5).abs() < ROUND_OFF);
    }
}

#[test]
fn length_never_grows_by_resampling() {
    for seed in 1..60 {
        let source = random_strand(seed, 14);
        let before = arc_length(&source);
        for n in [2, 5, 25, 100] {
            let after = arc_length(Groom::from_strands(std::slice::from_ref(&source)).resample(n).unwrap().strand(0));
            assert!(after <= before * (1.0 + ROUND_OFF), "seed {seed}, {n} particles: {before} to {after}");
        }
    }
}

#[test]
fn repeated_points_do_not_stop_resampling() {
    let strand = vec![[0.0; 3], [0.0; 3], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 4.0], [0.0, 0.0, 4.0]];
    let uniform = Groom::from_strands(&[strand]).resample(5).unwrap();
    let z: Vec<f32> = uniform.strand(0).iter().map(|p| p[2]).collect();
    assert_eq!(z, [0.0, 1.0, 2.0, 3.0, 4.0]);
}

#[test]
fn the_first_unusable_strand_and_their_number_are_named() {
    let good = vec![[0.0; 3], [0.0, 0.0, 1.0]];
    let point = vec![[1.0; 3]];
    let nothing = vec![[2.0; 3], [2.0; 3]];
    let lost = vec![[0.0; 3], [f32::NAN, 0.0, 0.0]];
    let check = |strands: &[&Vec<[f32; 3]>]| {
        Groom::from_strands(&strands.iter().map(|s| (*s).clone()).collect::<Vec<_>>()).validate()
    };
    assert!(check(&[&good]).is_ok());
    assert!(matches!(check(&[]), Err(Error::EmptyGroom)));
    assert!(matches!(check(&[&good, &point, &point]), Err(Error::TooFewPoints { strand: 1, n_points: 1, n_bad: 2 })));
    assert!(matches!(
        check(&[&good, &nothing, &good, &nothing]),
        Err(Error::DegenerateStrand { strand: 1, n_bad: 2, .. })
    ));
    assert!(matches!(check(&[&lost, &good]), Err(Error::NonFiniteStrand { strand: 0, point: 1, n_bad: 1 })));
    let unequal = Groom { point_counts: vec![3], points: good.clone() };
    assert!(matches!(unequal.validate(), Err(Error::PointCountMismatch { n_points: 2, n_counted: 3 })));
    assert!(unequal.resample(8).is_err());

    let mut groom = Groom::from_strands(&[point, good.clone(), nothing, lost, good]);
    assert_eq!(groom.drop_degenerate(), 3);
    assert_eq!(groom.n_strands(), 2);
    groom.validate().unwrap();
}

#[test]
fn strands_offsets_and_iteration_agree() {
    let groom = Groom::from_strands(&[random_strand(1, 3), random_strand(2, 2), random_strand(3, 5)]);
    assert_eq!(groom.offsets(), [0, 3, 5, 10]);
    for (i, strand) in groom.strands().enumerate() {
        assert_eq!(strand, groom.strand(i));
        assert_eq!(strand, &groom.points[groom.offsets()[i]..groom.offsets()[i + 1]]);
    }
}

#[test]
fn a_transform_scales_then_mirrors_then_moves() {
    let groom = Groom::from_strands(&[vec![[1.0, 2.0, 3.0], [0.0; 3]]]);
    let moved = groom.transformed(2.0, negate_axes([false, false, true]), [10.0, 0.0, 0.0]);
    assert_eq!(moved.points, [[12.0, 4.0, -6.0], [10.0, 0.0, 0.0]]);
}

#[test]
fn units_are_centimetres_per_unit_and_never_guessed() {
    for (text, cm) in [("m", 100.0), ("cm", 1.0), ("mm", 0.1), ("in", 2.54), ("0.38", 0.38), ("5.6", 5.6)] {
        assert_eq!(text.parse::<LengthUnit>().unwrap().cm_per_unit(), cm);
    }
    for text in ["", "feet", "-1", "0", "NaN", "inf", "1e999"] {
        let error = text.parse::<LengthUnit>().unwrap_err().to_string();
        assert!(error.contains("centimetres per unit"), "{error}");
    }
}

#[test]
fn a_hair_file_gives_its_strands_in_centimetres() {
    let groom = parse_hair(here(), &hair_bytes(), LengthUnit::M).unwrap();
    assert_eq!(groom.point_counts, [3, 2]);
    assert_eq!(groom.strand(1), [[100.0, 0.0, 0.0], [100.0, 0.0, 400.0]]);

    let mut lower = hair_bytes();
    lower[..4].copy_from_slice(b"hair");
    assert_eq!(parse_hair(here(), &lower, LengthUnit::M).unwrap(), groom);
}

#[test]
fn a_hair_file_without_segments_uses_the_default() {
    let mut b = hair_header(2, 4, 2, 1);
    push_floats(&mut b, &[0.0; 12]);
    let groom = parse_hair(here(), &b, LengthUnit::Cm).unwrap();
    assert_eq!(groom.point_counts, [2, 2]);
    // Read, but not hair: the caller is told, and may drop them.
    assert!(matches!(groom.validate(), Err(Error::DegenerateStrand { strand: 0, n_bad: 2, .. })));
}

#[test]
fn every_cut_of_a_hair_file_is_refused() {
    let whole = hair_bytes();
    for n in 0..whole.len() {
        let error = parse_hair(here(), &whole[..n], LengthUnit::Cm).unwrap_err();
        assert!(matches!(error, Error::Truncated { .. }), "{n} bytes: {error}");
    }
    let error = parse_hair(here(), &whole[..150], LengthUnit::Cm).unwrap_err().to_string();
    assert!(error.contains("points") && error.contains("byte 132") && error.contains("60 bytes"), "{error}");
}

#[test]
fn counts_beyond_the_file_are_refused_before_anything_is_allocated() {
    for (strands, points, bits, segments) in [
        (u32::MAX, u32::MAX, 3, 0),
        (u32::MAX, u32::MAX, 2, 0),
        (1, u32::MAX, 2, u32::MAX - 1),
        (1 << 16, 0, 2, (1 << 16) - 1),
        (2, 9, 3, 0),
        (2, 5, 1, 0),
        (0, 0, 2, u32::MAX),
        (2, 5, 0, 0),
    ] {
        let mut b = hair_bytes();
        b[..20].copy_from_slice(&hair_header(strands, points, bits, segments)[..20]);
        let error = parse_hair(here(), &b, LengthUnit::Cm).unwrap_err();
        assert!(matches!(error, Error::Truncated { .. } | Error::BadField { .. }), "{error}");
    }
    for (strands, n) in [(u32::MAX, 16), (u32::MAX, u32::MAX), (1, u32::MAX), (0, 16), (4, 0), (4, 1)] {
        let mut b = tfx_bytes(4.0, 2, 4);
        b[4..8].copy_from_slice(&strands.to_le_bytes());
        b[8..12].copy_from_slice(&n.to_le_bytes());
        let error = parse_tfx(here(), &b, LengthUnit::Cm).unwrap_err();
        assert!(matches!(error, Error::Truncated { .. } | Error::BadField { .. }), "{error}");
    }
}

#[test]
fn a_hair_file_with_a_coordinate_that_is_no_number_is_refused_with_its_offset() {
    let mut b = hair_bytes();
    let at = 132 + 12 * 3 + 4;
    b[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let error = parse_hair(here(), &b, LengthUnit::Cm).unwrap_err().to_string();
    assert!(error.contains("point 3") && error.contains("byte 168"), "{error}");
    // Finite in the file, infinite once converted.
    b[at..at + 4].copy_from_slice(&1e38_f32.to_le_bytes());
    assert!(parse_hair(here(), &b, LengthUnit::M).is_err());
}

#[test]
fn other_files_are_not_hair() {
    let error = parse_hair(here(), b"solid cube of iron", LengthUnit::Cm).unwrap_err();
    assert!(matches!(error, Error::BadMagic { format: "hair", .. }), "{error}");
    assert!(error.to_string().contains("solid cu"));
}

#[test]
fn writing_and_reading_hair_returns_the_same_groom() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.hair");
    let groom = Groom::from_strands(&[random_strand(5, 4), random_strand(6, 1), random_strand(7, 30)]);
    write_hair(&path, &groom, LengthUnit::Cm).unwrap();
    assert_eq!(read_hair(&path, LengthUnit::Cm).unwrap(), groom);
    assert_eq!(io_formats::read_groom(&path, LengthUnit::Cm).unwrap(), groom);

    let empty_strand = Groom { point_counts: vec![2, 0], points: vec![[0.0; 3]; 2] };
    assert!(write_hair(&path, &empty_strand, LengthUnit::Cm).unwrap_err().to_string().contains("strand 1"));
}

#[test]
fn a_tfx_file_gives_its_strands_in_centimetres_in_either_version() {
    for version in [3.0, 4.0] {
        let groom = parse_tfx(here(), &tfx_bytes(version, 3, 4), LengthUnit::Mm).unwrap();
        assert_eq!(groom.point_counts, [4, 4, 4]);
        assert_eq!(groom.strand(2)[3], [0.2, 0.0, 0.3]);
    }
}

#[test]
fn every_cut_of_a_tfx_file_is_refused() {
    for version in [3.0, 4.0] {
        let whole = tfx_bytes(version, 2, 4);
        for n in 0..whole.len() {
            let error = parse_tfx(here(), &whole[..n], LengthUnit::Cm).unwrap_err();
            assert!(matches!(error, Error::Truncated { .. }), "{n} bytes: {error}");
        }
    }
}

#[test]
fn a_tfx_file_of_another_version_is_refused() {
    for version in [2.0, 5.0] {
        let error = parse_tfx(here(), &tfx_bytes(version, 2, 4), LengthUnit::Cm).unwrap_err();
        assert!(matches!(error, Error::UnsupportedVersion { .. }), "{error}");
        assert!(error.to_string().contains("versions 3 and 4 are read"), "{error}");
    }
    assert!(matches!(parse_tfx(here(), &tfx_bytes(f32::NAN, 2, 4), LengthUnit::Cm), Err(Error::BadMagic { .. })));
}

#[test]
fn a_data_file_gives_its_strands_without_bald_roots() {
    let groom = parse_data(here(), &data_bytes(), LengthUnit::Mm).unwrap();
    assert_eq!(groom.point_counts, [3, 2]);
    assert_eq!(groom.strand(1), [[0.1, 0.0, 0.0], [0.1, 0.0, 0.1]]);
}

#[test]
fn a_data_file_cut_short_or_too_long_or_of_absurd_counts_is_refused() {
    let whole = data_bytes();
    for n in 0..whole.len() {
        let error = parse_data(here(), &whole[..n], LengthUnit::Cm).unwrap_err();
        assert!(matches!(error, Error::Truncated { .. }), "{n} bytes: {error}");
    }
    let error = parse_data(here(), &[&whole[..], &[0]].concat(), LengthUnit::Cm).unwrap_err();
    assert!(error.to_string().contains("1 bytes follow"), "{error}");
    for (at, count) in [(0, -1), (4, -3), (4, 0), (0, i32::MAX), (4, i32::MAX)] {
        let mut b = whole.clone();
        b[at..at + 4].copy_from_slice(&i32::to_le_bytes(count));
        let error = parse_data(here(), &b, LengthUnit::Cm).unwrap_err();
        assert!(matches!(error, Error::Truncated { .. } | Error::BadField { .. }), "{at}, {count}: {error}");
    }
}

#[test]
fn tfx_positions_inside_the_header_or_past_the_end_are_refused() {
    for offset in [0_u32, 12, 159, 161, u32::MAX] {
        let mut b = tfx_bytes(4.0, 2, 4);
        b[12..16].copy_from_slice(&offset.to_le_bytes());
        let error = parse_tfx(here(), &b, LengthUnit::Cm).unwrap_err();
        assert!(matches!(error, Error::Truncated { .. } | Error::BadField { .. }), "{offset}: {error}");
    }
}

#[test]
fn an_unknown_extension_is_refused_with_those_that_would_do() {
    let error = io_formats::read_groom(Path::new("a.abc"), LengthUnit::Cm).unwrap_err();
    assert!(error.to_string().contains(".hair, .tfx"), "{error}");
    let error = io_formats::read_mesh(Path::new("mesh"), LengthUnit::Cm).unwrap_err();
    assert!(error.to_string().contains(".obj, .stl"), "{error}");
}
