//! Roots on a scalp that deforms (MS08 §6): rigid motion as a special case, roots exactly on the surface, hair that
//! follows.

use nalgebra::{Isometry3, Vector3};
use strand_sim::{Error, Material, RootMotion, Scalp, StepInput, StepParams, StepWorkspace, StrandSystem};

/// A few units in the last place of coordinates of ten centimetres.
const ROUND_OFF_CM: f64 = 1e-12;
const DT_S: f64 = 0.01;
const N_PARTICLES: usize = 13;
const SPACING_CM: f64 = 0.8;
const N_SIDE: u32 = 12;

/// A cap of a ball of 9 cm as a triangulated square patch.
fn cap() -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    let along = |k: u32| f64::from(k) / f64::from(N_SIDE) * 10.0 - 5.0;
    let vertices = (0..(N_SIDE + 1) * (N_SIDE + 1)).map(|n| {
        let (x, z) = (along(n % (N_SIDE + 1)), along(n / (N_SIDE + 1)));
        Vector3::new(x, (81.0 - x * x - z * z).sqrt(), z)
    });
    let at = |i: u32, j: u32| j * (N_SIDE + 1) + i;
    let triangles = (0..N_SIDE * N_SIDE).flat_map(|n| {
        let (i, j) = (n % N_SIDE, n / N_SIDE);
        [[at(i, j), at(i, j + 1), at(i + 1, j)], [at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]]
    });
    (vertices.collect(), triangles.collect())
}

/// A root inside every third triangle, at weights that differ from one to the next.
fn roots_on(vertices: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Vec<Vector3<f64>> {
    let root = |(n, t): (usize, &[u32; 3])| {
        let (u, v) = (0.1 + 0.5 * (0.37 * n as f64).fract(), 0.05 + 0.3 * (0.61 * n as f64).fract());
        let [a, b, c] = t.map(|v| vertices[v as usize]);
        a * (1.0 - u - v) + b * u + c * v
    };
    triangles.iter().enumerate().step_by(3).map(root).collect()
}

/// Strands that leave the cap along the ball's radius and bend a little.
fn strands(roots: &[Vector3<f64>]) -> StrandSystem {
    let points: Vec<_> = roots
        .iter()
        .flat_map(|&root| {
            (0..N_PARTICLES).map(move |i| {
                let s = SPACING_CM * i as f64;
                root + root.normalize() * s + Vector3::new(0.02, 0.0, 0.01) * (s * s)
            })
        })
        .collect();
    StrandSystem::new(&points, N_PARTICLES, Material::straight()).expect("a sound scalp")
}

fn head(t: f64) -> Isometry3<f64> {
    Isometry3::new(Vector3::new(3.0 * t, (5.0 * t).sin(), 0.0), Vector3::new(0.2, 1.0, 0.4) * (4.0 * t).sin())
}

/// A face that pulls at the scalp: a smooth stretch and shift, up to a centimetre.
fn pulled(vertices: &[Vector3<f64>], t: f64) -> Vec<Vector3<f64>> {
    let swing = (6.0 * t).sin();
    let pull = |p: &Vector3<f64>| {
        let wave = Vector3::new(0.08 * p.x, 0.4 * (0.6 * p.x).sin(), 0.3 * (0.5 * p.z).cos());
        head(t).transform_point(&(p + wave * swing).into()).coords
    };
    vertices.iter().map(pull).collect()
}

#[test]
fn an_unmoved_scalp_leaves_every_strand_where_it_was() {
    let (vertices, triangles) = cap();
    let roots = roots_on(&vertices, &triangles);
    let scalp = Scalp::bind(&vertices, &triangles, &roots).unwrap();
    let mut frames = Vec::new();
    scalp.frames(&vertices, &mut frames).unwrap();
    assert_eq!(frames.len(), roots.len());
    for (frame, root) in frames.iter().zip(&roots) {
        assert!((frame.transform_point(&(*root).into()).coords - root).norm() < ROUND_OFF_CM);
        assert!(frame.rotation.angle() < ROUND_OFF_CM && frame.translation.vector.norm() < 20.0 * ROUND_OFF_CM);
    }
}

#[test]
fn a_scalp_moved_rigidly_carries_hair_as_a_rigid_head_does() {
    /// Round-off of the frames, grown over the steps by stiff springs that it rings.
    const SIMULATED_CM: f64 = 1e-7;
    let (vertices, triangles) = cap();
    // Also off the mesh, and over its border.
    let mut roots = roots_on(&vertices, &triangles);
    for (k, root) in roots.iter_mut().enumerate() {
        *root *= 1.0 + 0.01 * (k % 3) as f64;
    }
    roots.push(Vector3::new(5.5, 5.5, 0.3));
    let scalp = Scalp::bind(&vertices, &triangles, &roots).unwrap();
    let system = strands(&roots);
    let posed = |t: f64| {
        let moved: Vec<_> = vertices.iter().map(|v| head(t).transform_point(&(*v).into()).coords).collect();
        let mut frames = Vec::new();
        scalp.frames(&moved, &mut frames).unwrap();
        for frame in &frames {
            let off = (frame.to_homogeneous() - head(t).to_homogeneous()).norm();
            assert!(off < 100.0 * ROUND_OFF_CM, "{off}");
        }
        frames
    };
    let params = StepParams::standard();
    let (mut by_scalp, mut by_head) = (system.rest_state(&head(0.0)), system.rest_state(&head(0.0)));
    let (mut w1, mut w2) = (StepWorkspace::default(), StepWorkspace::default());
    let mut worst = 0.0f64;
    for k in 0..20 {
        let (t0, t1) = (DT_S * f64::from(k), DT_S * f64::from(k + 1));
        // One substep: between the ends of a step a frame turns about its own origin.
        let params = StepParams { substeps: strand_sim::Substeps::Fixed(1), ..params };
        let carried = StepInput::carried(DT_S, head(t0), head(t1));
        let (before, after) = (posed(t0), posed(t1));
        let embedded = StepInput { roots: RootMotion::Frames { before: &before, after: &after }, ..carried };
        system.step(&mut by_scalp, &embedded, &params, &mut w1);
        system.step(&mut by_head, &carried, &params, &mut w2);
        for (a, b) in system.positions(&by_scalp).iter().zip(system.positions(&by_head)) {
            worst = worst.max((a - b).norm());
        }
    }
    println!("largest difference over 20 steps: {worst:e} cm");
    assert!(worst < SIMULATED_CM, "{worst}");
}

#[test]
fn a_stretched_scalp_carries_roots_exactly() {
    let (vertices, triangles) = cap();
    let roots = roots_on(&vertices, &triangles);
    let scalp = Scalp::bind(&vertices, &triangles, &roots).unwrap();
    // A linear map takes barycentric points to the images of the rest points.
    let stretch = |p: &Vector3<f64>| Vector3::new(1.5 * p.x + 0.2 * p.y, 0.8 * p.y, p.z - 0.3 * p.x);
    let deformed: Vec<_> = vertices.iter().map(stretch).collect();
    let mut frames = Vec::new();
    scalp.frames(&deformed, &mut frames).unwrap();
    for ((frame, root), embedded) in frames.iter().zip(&roots).zip(scalp.roots(&deformed)) {
        assert!((frame.transform_point(&(*root).into()).coords - stretch(root)).norm() < 10.0 * ROUND_OFF_CM);
        assert!((embedded - stretch(root)).norm() < 10.0 * ROUND_OFF_CM);
    }
    for binding in scalp.bindings() {
        assert!((binding.weights.iter().sum::<f64>() - 1.0).abs() < ROUND_OFF_CM);
        assert!(binding.weights.iter().all(|w| (0.0..=1.0).contains(w)));
    }
}

#[test]
fn hair_follows_a_scalp_that_deforms_its_roots_on_the_surface_and_its_stretch_in_bounds() {
    let (vertices, triangles) = cap();
    let roots = roots_on(&vertices, &triangles);
    let scalp = Scalp::bind(&vertices, &triangles, &roots).unwrap();
    let system = strands(&roots);
    let params = StepParams::standard();
    let rest = system.positions(&system.rest_state(&Isometry3::identity()));
    let (mut state, mut workspace) = (system.rest_state(&head(0.0)), StepWorkspace::default());
    let (mut before, mut after) = (Vec::new(), Vec::new());
    scalp.frames(&pulled(&vertices, 0.0), &mut before).unwrap();
    let (mut longest, mut off) = (0.0f64, 0.0f64);
    for k in 0..100 {
        let now = pulled(&vertices, DT_S * f64::from(k + 1));
        scalp.frames(&now, &mut after).unwrap();
        let still = StepInput::still(DT_S, Isometry3::identity());
        let input = StepInput { roots: RootMotion::Frames { before: &before, after: &after }, ..still };
        let report = system.step(&mut state, &input, &params, &mut workspace);
        assert_eq!(report.quarantined, 0);
        let x = system.positions(&state);
        for (strand, on_surface) in scalp.roots(&now).enumerate() {
            off = off.max((x[strand * N_PARTICLES] - on_surface).norm());
        }
        for (x, rest) in x.chunks(N_PARTICLES).zip(rest.chunks(N_PARTICLES)) {
            for (now, then) in x.windows(2).zip(rest.windows(2)) {
                longest = longest.max((now[1] - now[0]).norm() / (then[1] - then[0]).norm() - 1.0);
            }
        }
        std::mem::swap(&mut before, &mut after);
    }
    println!("roots {off:e} cm off the surface, segments stretched by up to {longest}");
    assert!(off < 10.0 * ROUND_OFF_CM, "{off}");
    assert!(longest < params.strain_limit + ROUND_OFF_CM, "{longest}");
}

#[test]
fn what_cannot_carry_a_root_is_refused_by_name() {
    let (vertices, triangles) = cap();
    let roots = roots_on(&vertices, &triangles);
    let bind = |v: &[Vector3<f64>], t: &[[u32; 3]], r: &[Vector3<f64>]| Scalp::bind(v, t, r);
    assert!(matches!(bind(&vertices, &[], &roots), Err(Error::NoTriangles { n_triangles: 0 })));
    assert!(matches!(bind(&vertices, &[[3, 3, 7]], &roots), Err(Error::NoTriangles { n_triangles: 1 })));
    let beyond = vertices.len() as u32;
    let unknown = bind(&vertices, &[[0, 1, 13], [0, 1, beyond]], &roots);
    assert!(matches!(unknown, Err(Error::UnknownPoint { element: 1, .. })));
    let lost = [Vector3::new(0.0, f64::NAN, 0.0)];
    assert!(matches!(bind(&vertices, &triangles, &lost), Err(Error::NonFinite { strand: 0, particle: 0 })));
    let scalp = bind(&vertices, &triangles, &roots).unwrap();
    let mut frames = Vec::new();
    let short = scalp.frames(&vertices[1..], &mut frames);
    assert!(matches!(short, Err(Error::OtherMesh { .. })));
    let collapsed = vec![Vector3::zeros(); vertices.len()];
    assert!(matches!(scalp.frames(&collapsed, &mut frames), Err(Error::LostTriangle { strand: 0, .. })));
    let mut torn = vertices.clone();
    torn[5].x = f64::INFINITY;
    assert!(matches!(scalp.frames(&torn, &mut frames), Err(Error::NonFinitePoint { point: 5 })));
    assert!(frames.is_empty(), "a refused mesh leaves the frames alone");
}
