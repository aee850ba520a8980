//! Laws of scene files; the examples of docs/SCENE.md are read too, so that the document stays true.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "test code")]

use std::path::Path;

use io_formats::scene::{Attach, GroomSource, HairStyle, HeadShape, MotionSpec, MotionUse, SolidShape};
use io_formats::{Error, LengthUnit, Scene};
use nalgebra::Point3;

const ROUND_OFF_CM: f64 = 1e-9;

const SMALLEST: &str = "name = \"a\"\n[groom]\ngenerator = { style = \"wavy\", strands = 200 }\n";

fn scene(text: &str) -> Result<Scene, Error> {
    Scene::from_toml(text, Path::new("/scenes"))
}

/// The TOML blocks of docs/SCENE.md.
fn documented() -> Vec<String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/SCENE.md");
    let text = std::fs::read_to_string(path).unwrap();
    text.split("```toml\n").skip(1).map(|b| b.split("```").next().unwrap().to_owned()).collect()
}

#[test]
fn the_documented_examples_are_valid() {
    let examples = documented();
    assert_eq!(examples.len(), 3);
    let comb = scene(&examples[0]).unwrap();
    assert_eq!((comb.solids.len(), comb.n_steps(), comb.groom.guides), (2, 400, 100));
    assert!(matches!(comb.solids[0].shape, SolidShape::Comb { teeth: 13, .. }));
    assert_eq!(comb.solids[0].attach, Attach::Head);
    assert_eq!(comb.material.friction, Some(0.25));
    let SolidShape::Mesh(hand) = &comb.solids[1].shape else { panic!("the hand is a mesh") };
    assert_eq!((hand.unit, hand.center), (LengthUnit::Other(19.0), true));
    assert_eq!(hand.path, Path::new("/scenes/solids/hand_closed.obj"));
    let MotionSpec::Bvh { path, skip_frames: 1, .. } = &comb.solids[1].motion else { panic!("the hand moves") };
    assert_eq!(path, Path::new("/scenes/motion/wave.bvh"));

    let recorded = scene(&examples[2]).unwrap().train.recorded;
    assert_eq!((recorded.len(), recorded[0].used_for, recorded[0].seconds), (1, MotionUse::HeldOut, 4.0));
    let MotionSpec::Bvh { path, skip_frames: 1, .. } = &recorded[0].motion else { panic!("a recording") };
    assert_eq!(path, Path::new("/scenes/motions/nodding.bvh"));

    let tail = scene(&examples[1]).unwrap();
    assert_eq!(
        tail.groom.source,
        GroomSource::File {
            path: "/scenes/grooms/tail.tfx".into(),
            unit: LengthUnit::Other(0.38),
            negate: [false, false, true],
            translate_cm: [0.0, -120.0, 0.0],
        }
    );
}

#[test]
fn defaults_are_those_documented() {
    let s = scene(SMALLEST).unwrap();
    assert_eq!((s.seconds, s.step_s, s.fps), (4.0, 0.01, 24.0));
    assert_eq!((s.groom.particles, s.groom.guides, s.groom.max_eligible), (25, 100, 9));
    assert!(!s.groom.drop_degenerate && s.solids.is_empty());
    assert_eq!((s.head.shape.clone(), s.head.motion.clone()), (HeadShape::Builtin, MotionSpec::Still));
    assert_eq!((s.material.preset, s.material.bend), (HairStyle::Straight, None));
    assert_eq!((s.train.fps, s.train.sparsity, s.train.min_weight), (25.0, 0.015, 0.01));
    assert_eq!((s.camera.width, s.camera.vertical_fov_deg), (768, 35.0));
    assert_eq!(s.head_motion().unwrap().pose_at(1.0), nalgebra::Isometry3::identity());
}

#[test]
fn every_scene_of_the_repository_can_be_read() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../bench/scenes");
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let s = Scene::read(&path).unwrap();
        assert_eq!(path.file_stem().unwrap().to_str(), Some(s.name.as_str()), "a scene is found by its name");
        names.push(s.name);
    }
    assert!(names.len() >= 12, "{names:?}");
}

#[test]
fn a_ball_of_hair_and_gears_come_with_their_sizes() {
    let s = scene(&format!(
        "{SMALLEST}[head]\nbuiltin = \"ball\"\nradius_cm = 8\n[[solid]]\nname = \"g\"\nshape = {{ kind = \"gear\", \
         teeth = 18, spokes = 5, radius_cm = 5, tooth_cm = 0.7, bore_cm = 0.8, width_cm = 1.2 }}\n"
    ))
    .unwrap();
    assert_eq!(s.head.shape, HeadShape::Ball(8.0));
    let SolidShape::Gear { teeth, spokes, width_cm, .. } = s.solids[0].shape else { panic!("a gear was given") };
    assert_eq!((teeth, spokes, width_cm), (18, 5, 1.2));
}

#[test]
fn every_style_is_known_by_its_name() {
    for (name, style) in [("straight", HairStyle::Straight), ("wavy", HairStyle::Wavy), ("curly", HairStyle::Curly)] {
        let text = SMALLEST.replace("wavy", name);
        let s = scene(&format!("{text}[material]\npreset = \"{name}\"\n")).unwrap();
        assert_eq!(s.material.preset, style);
        assert!(matches!(s.groom.source, GroomSource::Generated(of) if of.style == style));
    }
    assert!(scene(&SMALLEST.replace("wavy", "frizzy")).unwrap_err().to_string().contains("frizzy"));
}

#[test]
fn every_field_that_makes_no_sense_is_refused_by_name() {
    let solid = |rest: &str| format!("{SMALLEST}[[solid]]\nname = \"s\"\n{rest}\n");
    let comb = |teeth: &str, pitch: &str| {
        solid(&format!(
            "shape = {{ kind = \"comb\", teeth = {teeth}, pitch_cm = {pitch}, tooth_radius_cm = 0.1, \
             tooth_length_cm = 3, spine_radius_cm = 0.3 }}"
        ))
    };
    let gear = |teeth: &str, tooth: &str| {
        solid(&format!(
            "shape = {{ kind = \"gear\", teeth = {teeth}, spokes = 5, radius_cm = 5, tooth_cm = {tooth}, bore_cm = 0.8, \
             width_cm = 1 }}"
        ))
    };
    let sphere = "shape = { kind = \"sphere\", radius_cm = 1.0 }\n";
    let top = |line: &str| format!("{line}\n{SMALLEST}");
    let groom = |line: &str| format!("{SMALLEST}{line}\n");
    let cases = [
        (top("seconds = 0"), "seconds"),
        (top("seconds = nan"), "seconds"),
        (top("step_s = -0.01"), "step_s"),
        (top("fps = inf"), "fps"),
        (SMALLEST.replace("\"a\"", "\"\""), "name"),
        (SMALLEST.replace("200", "0"), "groom.generator.strands"),
        (SMALLEST.replace("200", "99"), "groom.guides"),
        (groom("particles = 3"), "groom.particles"),
        (groom("guides = 0"), "groom.guides"),
        (groom("max_eligible = 10"), "groom.max_eligible"),
        (comb("0", "0.5"), "solid.s.shape.teeth"),
        (comb("9", "0.2"), "solid.s.shape.pitch_cm"),
        (comb("9", "nan"), "solid.s.shape.pitch_cm"),
        (solid("shape = { kind = \"sphere\", radius_cm = -1.0 }"), "solid.s.shape.radius_cm"),
        (solid("shape = { kind = \"rod\", radius_cm = 1, length_cm = 0 }"), "solid.s.shape.length_cm"),
        (solid(&format!("{sphere}friction = -0.1")), "solid.s.friction"),
        (solid(&format!("{sphere}keys = [{{ t = 1 }}, {{ t = 0.5 }}]")), "solid.s.keys[1].t"),
        (solid(&format!("{sphere}keys = [{{ t = nan }}]")), "solid.s.keys[0].t"),
        (solid(&format!("{sphere}keys = [{{ t = 0, rotate_deg = [0, inf, 0] }}]")), "solid.s.keys[0].rotate_deg"),
        (solid(&format!("{sphere}keys = []")), "solid.s.keys"),
        (solid(&format!("{sphere}[[solid]]\nname = \"s\"\n{sphere}")), "solid[1].name"),
        (groom("[head]\npivot_cm = [0, nan, 0]"), "head.pivot_cm"),
        (groom("[head]\nbuiltin = \"ball\"\nradius_cm = 0"), "head.radius_cm"),
        (gear("2", "0.5"), "solid.s.shape.teeth"),
        (gear("9", "-1"), "solid.s.shape.tooth_cm"),
        (groom("[head.motion]\nbvh = \"m\"\njoint = \"j\"\nunit = \"cm\"\nyaw_deg = nan"), "head.motion.yaw_deg"),
        (groom("[material]\nbend = -1"), "material.bend"),
        (groom("[material]\nlinear_density_g_per_cm = 0"), "material.linear_density_g_per_cm"),
        (groom("[train]\nsequences = 0"), "train.sequences"),
        (groom("[train]\nsparsity = nan"), "train.sparsity"),
        (groom("[camera]\nwidth = 0"), "camera.width"),
        (groom("[camera]\neye_cm = [0, -4, 0]"), "camera.target_cm"),
        (groom("[camera]\nvertical_fov_deg = 180"), "camera.vertical_fov_deg"),
    ];
    for (text, expected) in cases {
        match scene(&text) {
            Err(Error::SceneField { field, .. }) => assert_eq!(field, expected, "{text}"),
            other => panic!("{expected}: {other:?}\n{text}"),
        }
    }
}

#[test]
fn misspelt_missing_and_contradicting_fields_are_refused_with_their_line() {
    let with = |rest: &str| format!("{SMALLEST}{rest}\n");
    for (text, expected) in [
        ("name = \"a\"\n".to_owned(), "missing field `groom`"),
        (with("guidez = 3"), "guidez"),
        (with("[haed]"), "haed"),
        (with("[train]\nseqences = 3"), "seqences"),
        (with("file = \"a.hair\"\nunit = \"cm\""), "both a file and a generator"),
        (with("unit = \"cm\""), "go with groom.file only"),
        ("name = \"a\"\n[groom]\nfile = \"a.hair\"\n".into(), "groom.unit is required"),
        ("name = \"a\"\n[groom]\nparticles = 8\n".into(), "needs a file or a generator"),
        ("name = \"a\"\n[groom]\nfile = \"a.hair\"\nunit = \"furlong\"\n".into(), "furlong"),
        ("name = \"a\"\n[groom]\nfile = \"a.hair\"\nunit = -2\n".into(), "-2"),
        (with("[head]\nmesh = \"h.obj\""), "head.unit is required"),
        (with("[head]\nunit = \"m\""), "head has no mesh"),
        (with("[head]\nbuiltin = \"body\""), "only \"head\" and \"ball\" exist"),
        (with("[head]\nbuiltin = \"ball\""), "head.radius_cm is required"),
        (with("[head]\nradius_cm = 8"), "goes with head.builtin"),
        (with("[head.motion]\nbvh = \"m.bvh\"\nunit = \"cm\""), "head.motion.joint is required"),
        (with("[head.motion]\nbvh = \"m.bvh\"\njoint = \"Head\""), "head.motion.unit is required"),
        (with("[head.motion]\nskip_frames = 1"), "go with bvh only"),
        (with("[[solid]]\nname = \"s\""), "needs a mesh or a shape"),
        (with("[[solid]]\nname = \"s\"\nshape = { kind = \"cube\" }"), "cube"),
        (with("[[solid]]\nname = \"s\"\nshape = { kind = \"sphere\", radius = 1 }"), "radius"),
        (with("[[solid]]\nname = \"s\"\nshape = { kind = \"comb\", teeth = -1 }"), "-1"),
        (with("seconds = "), "line 4"),
    ] {
        let error = scene(&text).unwrap_err();
        assert!(matches!(error, Error::SceneSyntax { .. }), "{text}: {error}");
        let message = error.to_string();
        assert!(message.contains(expected) && message.contains("line "), "{expected}: {message}");
    }
}

#[test]
fn no_cut_of_a_scene_panics() {
    let text = &documented()[0];
    for n in (0..text.len()).filter(|&n| text.is_char_boundary(n)) {
        let _ = scene(&text[..n]);
    }
    assert!(matches!(Scene::read(Path::new("absent.toml")), Err(Error::Io { .. })));
}

#[test]
fn paths_are_taken_from_the_folder_of_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.toml");
    std::fs::write(&path, "name = \"a\"\n[groom]\nfile = \"in/a.hair\"\nunit = \"cm\"\n").unwrap();
    let s = Scene::read(&path).unwrap();
    let GroomSource::File { path, .. } = &s.groom.source else { panic!("a file was given") };
    assert_eq!(*path, folder.path().join("in/a.hair"));
    let error = s.groom.source.load_file().unwrap_err().to_string();
    assert!(error.contains("cannot read") && error.contains("a.hair"), "{error}");
}

#[test]
fn a_head_turned_by_keys_keeps_its_pivot() {
    let text = format!(
        "{SMALLEST}[head]\npivot_cm = [0, -8, 2]\n[head.motion]\nkeys = [{{ t = 0 }}, {{ t = 1, rotate_deg = [90, 0, 90] }}]\n"
    );
    let motion = scene(&text).unwrap().head_motion().unwrap();
    let pivot = Point3::new(0.0, -8.0, 2.0);
    assert!((motion.pose_at(1.0) * pivot - pivot).norm() < ROUND_OFF_CM);
    // About fixed axes, x first: y goes to z and stays there under the turn about z.
    let up = motion.pose_at(1.0) * Point3::new(0.0, -7.0, 2.0);
    assert!((up - Point3::new(0.0, -8.0, 3.0)).norm() < ROUND_OFF_CM, "{up}");
}

#[test]
fn a_mesh_is_centred_then_rotated() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("m.obj"), "v 10 0 0\nv 12 0 0\nv 10 4 0\nf 1 2 3\n").unwrap();
    let text = format!(
        "{SMALLEST}[[solid]]\nname = \"m\"\nmesh = \"m.obj\"\nunit = \"mm\"\ncenter = true\nrotate_deg = [0, 0, 90]\n"
    );
    let s = Scene::from_toml(&text, folder.path()).unwrap();
    let SolidShape::Mesh(mesh) = &s.solids[0].shape else { panic!("a mesh was given") };
    let (lo, hi) = mesh.load().unwrap().bounds().unwrap();
    for (value, expected) in lo.iter().chain(&hi).zip([-0.2, -0.1, 0.0, 0.2, 0.1, 0.0]) {
        assert!((value - expected).abs() < 1e-6, "{lo:?} {hi:?}");
    }
}
