//! Laws of the USD writer: the text it wrote is parsed back and compared with what it was given.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "test code")]

use std::path::Path;

use io_formats::{CurvesLook, Error, TriMesh, UsdaTiming, UsdaWriter};
use nalgebra::{Isometry3, Point3, Vector3};

/// Half of the last of three decimals, and the round-off of an `f32` of that size.
const THREE_DECIMALS_CM: f32 = 0.000_51;
/// Doubles are written in full.
const ROUND_OFF: f64 = 1e-12;

const TIMING: UsdaTiming = UsdaTiming { fps: 24.0, start: 1, n_frames: 3 };

fn position(frame: usize, i: usize) -> [f32; 3] {
    [i as f32 * 1.234_567 - 3.0, frame as f32 * -0.000_4, 100.0 / (1 + i + frame) as f32]
}

fn write(path: &Path) -> Result<(), Error> {
    let mut w = UsdaWriter::create(path, TIMING)?;
    w.write_curves("hair", &[3, 2], CurvesLook::brown(), |frame, points| {
        for (i, p) in points.iter_mut().enumerate() {
            *p = position(frame, i);
        }
        Ok(())
    })?;
    w.write_mesh("13 tooth comb", &triangle(), &[0.0, 0.5, 1.0].map(pose))?;
    w.finish()
}

fn triangle() -> TriMesh {
    TriMesh { vertices: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.123_456, 0.0]], triangles: vec![[0, 1, 2]] }
}

fn pose(t: f64) -> Isometry3<f64> {
    Isometry3::new(Vector3::new(t, 2.0, -3.0), Vector3::new(0.3, t, 0.1))
}

/// All numbers of a text.
fn numbers(text: &str) -> Vec<f64> {
    text.split(|c: char| !(c.is_ascii_digit() || "+-.e".contains(c))).filter_map(|w| w.parse().ok()).collect()
}

/// The samples of an attribute: time code, numbers.
fn samples(text: &str, attribute: &str) -> Vec<(i64, Vec<f64>)> {
    let start = text.find(&format!("{attribute}.timeSamples = {{")).unwrap();
    let block = text[start..].split_once("= {\n").unwrap().1.split_once("        }\n").unwrap().0;
    block
        .lines()
        .map(|line| {
            let (time, values) = line.split_once(':').unwrap();
            (time.trim().parse().unwrap(), numbers(values))
        })
        .collect()
}

#[test]
fn what_was_written_reads_back_to_the_last_decimal() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usda");
    write(&path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.starts_with("#usda 1.0\n"));
    for line in
        ["metersPerUnit = 0.01", "upAxis = \"Y\"", "timeCodesPerSecond = 24", "startTimeCode = 1", "endTimeCode = 3"]
    {
        assert!(text.contains(line), "{line}");
    }
    assert!(text.contains("int[] curveVertexCounts = [3,2]\n"));
    assert!(text.contains("def Mesh \"_13_tooth_comb\""));
    assert_eq!(text.matches('{').count(), text.matches('}').count());

    let points = samples(&text, "points");
    let extents = samples(&text, "extent");
    assert_eq!(points.iter().map(|s| s.0).collect::<Vec<_>>(), [1, 2, 3]);
    for (frame, (_, values)) in points.iter().enumerate() {
        assert_eq!(values.len(), 15);
        for (i, v) in values.chunks(3).enumerate() {
            let expected = position(frame, i);
            for k in 0..3 {
                assert!((v[k] as f32 - expected[k]).abs() < THREE_DECIMALS_CM, "frame {frame}, point {i}");
                let (lo, hi) = (extents[frame].1[k], extents[frame].1[3 + k]);
                assert!(lo < v[k] && v[k] < hi, "the extent holds every point");
            }
        }
    }
}

#[test]
fn transforms_are_row_vectors_matrices() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usda");
    write(&path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let p = Point3::new(0.3, -2.0, 5.0);
    for (t, (_, m)) in [0.0, 0.5, 1.0].into_iter().zip(samples(&text, "xformOp:transform")) {
        let row = [p.x, p.y, p.z, 1.0];
        let moved: Vec<f64> = (0..4).map(|c| (0..4).map(|r| row[r] * m[4 * r + c]).sum()).collect();
        assert!((pose(t) * p - Point3::new(moved[0], moved[1], moved[2])).norm() < ROUND_OFF);
        assert!((moved[3] - 1.0).abs() < ROUND_OFF);
    }
}

#[test]
fn decimals_are_short_signed_and_rounded_to_nearest() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usda");
    let timing = UsdaTiming { n_frames: 1, ..TIMING };
    let mut w = UsdaWriter::create(&path, timing).unwrap();
    w.write_curves("hair", &[2], CurvesLook::brown(), |_, p| {
        p.copy_from_slice(&[[-0.000_6, 0.05, -12.0], [0.000_4, -0.000_4, 1_234.5]]);
        Ok(())
    })
    .unwrap();
    w.finish().unwrap();
    assert!(std::fs::read_to_string(&path).unwrap().contains("1: [(-0.001,0.05,-12),(0,0,1234.5)],\n"));
}

#[test]
fn what_cannot_be_written_is_refused_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usda");
    assert!(UsdaWriter::create(&path, UsdaTiming { n_frames: 0, ..TIMING }).is_err());
    assert!(UsdaWriter::create(&path, UsdaTiming { fps: f64::NAN, ..TIMING }).is_err());
    let mut w = UsdaWriter::create(&path, TIMING).unwrap();
    let still = |_: usize, _: &mut [[f32; 3]]| Ok(());
    assert!(w.write_curves("a", &[], CurvesLook::brown(), still).is_err());
    assert!(w.write_curves("b", &[2, 1], CurvesLook::brown(), still).is_err());
    let nan = |f: usize, p: &mut [[f32; 3]]| {
        p[1][0] = if f == 1 { f32::NAN } else { 0.0 };
        Ok(())
    };
    let error = w.write_curves("c", &[2], CurvesLook::brown(), nan).unwrap_err().to_string();
    assert!(error.contains("frame 1, point 1"), "{error}");
    assert!(w.write_mesh("c", &triangle(), &[pose(0.0); 3]).unwrap_err().to_string().contains("two prims"));
    assert!(w.write_mesh("d", &triangle(), &[pose(0.0); 2]).is_err());
    drop(w);
    assert!(!path.exists());
}
