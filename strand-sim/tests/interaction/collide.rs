//! Hairs thrown at each other do not pass; what stops them keeps momentum and gives no energy.

use crate::scenes::{Random, Scene, with_any_thread_count};
use collision::segment_pair::{Segment, between};
use nalgebra::Vector3;
use strand_sim::interaction::{
    CollideParams, CollisionReport, CollisionWorkspace, LinkSet, NearPairs, StictionParams, StictionWorkspace, collide,
    passes,
};

/// Sums over some hundred particles, through thousands of impulses.
const ROUND_OFF: f64 = 1e-10;

/// 10 m/s, cm/s.
const FAST: f64 = 1_000.0;

/// One ballistic step with collisions.
fn step(scene: &mut Scene, links: &LinkSet, dt: f64, workspace: &mut CollisionWorkspace) -> (Scene, CollisionReport) {
    let before = scene.clone();
    for (x, v) in scene.position.iter_mut().zip(&scene.velocity) {
        *x += v * dt;
    }
    let params = CollideParams::standard();
    let report = collide(&before.strands(), &mut scene.position, &mut scene.velocity, links, &params, dt, workspace);
    (before, report)
}

/// Two strands of 25 particles at a random angle, the second thrown at the first.
fn thrown(random: &mut Random) -> Scene {
    let mut scene = Scene::new(25);
    let towards = random.rotation() * Vector3::z();
    let across = |random: &mut Random| {
        let any = random.rotation() * Vector3::x();
        (any - towards * any.dot(&towards) * 0.8).normalize()
    };
    let (u, v) = (across(random), across(random));
    scene.add_strand(random, -u * 12.0, u, Vector3::zeros());
    let away = -towards * (2.0 + 3.0 * random.unit());
    let root = away - v * 12.0 + random.in_cube(3.0);
    scene.add_strand(random, root, v, towards * FAST);
    scene
}

/// Pairs of segments of different strands that a walk of small steps sees change sides inside both: a plain reference
/// for crossings that shares nothing with the search it checks.
fn walk_counts_crossings(before: &Scene, after: &Scene) -> usize {
    const N_STEPS: u32 = 60;
    let n = before.n_particles;
    let segment = |scene: &Scene, k: usize| [scene.position[k], scene.position[k + 1]];
    let lies_inside = |a: &Segment, b: &Segment| {
        let (u, v, w) = (a[1] - a[0], b[1] - b[0], b[0] - a[0]);
        let m = u.cross(&v);
        let (s, t) = (w.cross(&v).dot(&m) / m.norm_squared(), w.cross(&u).dot(&m) / m.norm_squared());
        (0.02..=0.98).contains(&s) && (0.02..=0.98).contains(&t)
    };
    let volume = |a: &Segment, b: &Segment| (a[1] - a[0]).cross(&(b[1] - b[0])).dot(&(b[0] - a[0]));
    let mut count = 0;
    for i in 0..n - 1 {
        for j in n..2 * n - 1 {
            let at = |k: u32| {
                let time = f64::from(k) / f64::from(N_STEPS);
                (
                    between(&segment(before, i), &segment(after, i), time),
                    between(&segment(before, j), &segment(after, j), time),
                )
            };
            let mut last = at(0);
            for k in 1..=N_STEPS {
                let now = at(k);
                let crossed = volume(&last.0, &last.1) * volume(&now.0, &now.1) < 0.0;
                if crossed && lies_inside(&last.0, &last.1) && lies_inside(&now.0, &now.1) {
                    count += 1;
                    break;
                }
                last = now;
            }
        }
    }
    count
}

fn thrown_strands_never_pass(dt: f64, n_steps: usize, n_cases: u64) {
    let (mut random, mut workspace) = (Random::new(dt.to_bits()), CollisionWorkspace::default());
    let (mut met, mut seen) = (0, 0);
    for case in 0..n_cases {
        let mut scene = thrown(&mut random);
        let mut collided = false;
        for _ in 0..n_steps {
            let (before, report) = step(&mut scene, &LinkSet::default(), dt, &mut workspace);
            assert_eq!(report.unresolved, 0, "case {case}: {report:?}");
            assert_eq!(passes(&before.strands(), &scene.position, &LinkSet::default(), 1e-6, &mut workspace), 0);
            if report.crossings > 0 {
                collided = true;
                assert_eq!(walk_counts_crossings(&before, &scene), 0, "case {case}");
                let mut free = before.clone();
                for (x, v) in free.position.iter_mut().zip(&before.velocity) {
                    *x += v * dt;
                }
                seen += usize::from(walk_counts_crossings(&before, &free) > 0);
            }
        }
        met += u64::from(collided);
    }
    assert!(2 * met > n_cases && seen > 0, "{met} of {n_cases} met: the law was hardly tried");
}

#[test]
fn strands_thrown_at_10_m_per_s_never_pass_in_steps_of_half_a_millisecond() {
    thrown_strands_never_pass(5e-4, 24, 200);
}

#[test]
fn strands_thrown_at_10_m_per_s_never_pass_in_steps_of_ten_milliseconds() {
    thrown_strands_never_pass(1e-2, 4, 600);
}

#[test]
fn stuck_pairs_are_passed_over() {
    let mut random = Random::new(77);
    let mut scene = thrown(&mut random);
    let mut workspace = CollisionWorkspace::default();
    // Until the next step would cross.
    loop {
        let mut ahead = scene.clone();
        let (before, report) = step(&mut ahead, &LinkSet::default(), 5e-4, &mut workspace);
        if report.crossings > 0 {
            scene = before;
            break;
        }
        scene = ahead;
    }
    let params = StictionParams { make_cm: 2.0, break_cm: 4.0, max_links: 16, ..StictionParams::dry() };
    let (mut near, mut links) = (NearPairs::default(), LinkSet::default());
    near.find(&scene.strands(), params.make_cm);
    links.update(&scene.strands(), near.pairs(), &params, &mut StictionWorkspace::default());
    let mut end = scene.position.clone();
    for (x, v) in end.iter_mut().zip(&scene.velocity) {
        *x += v * 5e-4;
    }
    let free = passes(&scene.strands(), &end, &LinkSet::default(), 1e-6, &mut workspace);
    assert!(free > passes(&scene.strands(), &end, &links, 1e-6, &mut workspace));
}

#[test]
fn collisions_keep_momentum_and_give_no_energy() {
    for seed in 0..5 {
        let mut scene = Scene::tangle(seed, 200, 4.0, FAST);
        let (before, report) = step(&mut scene, &LinkSet::default(), 5e-4, &mut CollisionWorkspace::default());
        assert!(report.answered > 100, "{report:?}");
        assert!((scene.momentum() - before.momentum()).norm() < ROUND_OFF * before.momentum_scale());
        assert!(scene.energy() < before.energy());
        // Positions and velocities were changed alike.
        for p in 0..scene.position.len() {
            let moved = (scene.position[p] - before.position[p]) / 5e-4;
            assert!((moved - scene.velocity[p]).norm() < ROUND_OFF * FAST * 10.0);
        }
    }
}

#[test]
fn a_tangle_at_full_speed_is_resolved_or_reported() {
    let (mut random_crossings, mut workspace) = (0, CollisionWorkspace::default());
    for seed in 0..5 {
        let mut scene = Scene::tangle(seed, 400, 5.0, FAST).with_roots(2);
        let (before, report) = step(&mut scene, &LinkSet::default(), 5e-4, &mut workspace);
        random_crossings += report.crossings;
        let left = passes(&before.strands(), &scene.position, &LinkSet::default(), 1e-6, &mut workspace);
        assert_eq!(left, report.unresolved);
        for p in (0..scene.position.len()).filter(|p| scene.inv_mass[*p] == 0.0) {
            assert_eq!(scene.velocity[p], before.velocity[p]);
        }
    }
    assert!(random_crossings > 500);
}

#[test]
fn a_hair_bounces_with_its_restitution() {
    let mut scene = Scene::new(2);
    scene.position = vec![-Vector3::x(), Vector3::x(), Vector3::new(0.0, -1.0, 0.5), Vector3::new(0.0, 1.0, 0.5)];
    let down = Vector3::new(0.0, 0.0, -100.0);
    scene.velocity = vec![Vector3::zeros(), Vector3::zeros(), down, down];
    scene.inv_mass = vec![4e4; 4];
    for restitution in [0.0, 0.5, 1.0] {
        let params = CollideParams { restitution, friction: 0.0, ..CollideParams::standard() };
        let mut after = scene.clone();
        let end = scene.position.iter().zip(&scene.velocity).map(|(x, v)| x + v * 0.01);
        after.position = end.collect();
        let report = collide(
            &scene.strands(),
            &mut after.position,
            &mut after.velocity,
            &LinkSet::default(),
            &params,
            0.01,
            &mut CollisionWorkspace::default(),
        );
        assert_eq!((report.crossings, report.unresolved), (1, 0));
        let relative = after.velocity[2].z - after.velocity[0].z;
        assert!((relative - restitution * 100.0).abs() < ROUND_OFF * 100.0, "{relative}");
    }
    assert!(CollideParams { restitution: 1.5, ..CollideParams::standard() }.validate().is_err());
}

#[test]
fn collisions_do_not_depend_on_the_thread_count() {
    let scene = Scene::tangle(9, 400, 8.0, FAST);
    with_any_thread_count(|| {
        let mut scene = scene.clone();
        let (_, report) = step(&mut scene, &LinkSet::default(), 5e-4, &mut CollisionWorkspace::default());
        (scene.position, scene.velocity, report)
    });
}
