//! Links are made with the closest, never exceed their number, break by distance alone, and pull as their springs say.

use crate::scenes::{Scene, with_any_thread_count};
use nalgebra::Vector3;
use strand_sim::interaction::{HairStyle, LinkSet, LinkSpring, NearPairs, StictionParams, StictionWorkspace, Strands};

/// Central differences of an energy of order one with steps of 1e-6 relative to lengths of 0.1.
const DERIVATIVE: f64 = 1e-5;

fn sticky() -> StictionParams {
    StictionParams { make_cm: 0.3, break_cm: 0.4, max_links: 3, ..StictionParams::dry() }
}

fn linked(strands: &Strands, links: &mut LinkSet, params: &StictionParams) {
    let mut near = NearPairs::default();
    near.find(strands, params.make_cm);
    links.update(strands, near.pairs(), params, &mut StictionWorkspace::default());
}

fn counts(links: &LinkSet, n_segments: usize) -> Vec<usize> {
    let mut counts = vec![0; n_segments];
    for link in links.links() {
        counts[link.i as usize] += 1;
        counts[link.j as usize] += 1;
    }
    counts
}

#[test]
fn no_segment_exceeds_its_links_and_none_is_linked_twice() {
    let mut scene = Scene::tangle(1, 300, 4.0, 50.0);
    let mut links = LinkSet::default();
    for _ in 0..20 {
        linked(&scene.strands(), &mut links, &sticky());
        assert!(counts(&links, scene.strands().n_segments()).into_iter().all(|n| n <= 3));
        assert!(links.links().is_sorted_by(|a, b| (a.i, a.j) < (b.i, b.j)));
        for link in links.links() {
            assert!(link.i < link.j && links.is_linked(link.i as usize, link.j as usize));
        }
        for (x, v) in scene.position.iter_mut().zip(&scene.velocity) {
            *x += v * 2e-3;
        }
    }
    assert!(links.links().len() > 300);
}

/// The links a sort would make: a candidate is linked when it is among the n closest of both its segments.
#[test]
fn the_heap_keeps_the_same_links_as_a_full_sort() {
    let scene = Scene::tangle(2, 300, 4.0, 0.0);
    let (strands, params) = (scene.strands(), sticky());
    let mut near = NearPairs::default();
    near.find(&strands, params.make_cm);
    let mut of_segment: Vec<Vec<(f64, usize)>> = vec![Vec::new(); strands.n_segments()];
    for (c, pair) in near.pairs().iter().enumerate() {
        for segment in [pair.i, pair.j] {
            of_segment[segment as usize].push((pair.data.offset.norm_squared(), c));
        }
    }
    let mut votes = vec![0; near.pairs().len()];
    for list in &mut of_segment {
        list.sort_by(|a, b| a.partial_cmp(b).expect("finite"));
        for (_, c) in list.iter().take(params.max_links) {
            votes[*c] += 1;
        }
    }
    let expected: Vec<_> = near.pairs().iter().zip(&votes).filter(|(_, v)| **v == 2).map(|(p, _)| (p.i, p.j)).collect();
    assert!(expected.len() < near.pairs().len() / 2, "the limit must bind for the heap to be tried");
    let mut links = LinkSet::default();
    linked(&strands, &mut links, &params);
    assert_eq!(links.links().iter().map(|l| (l.i, l.j)).collect::<Vec<_>>(), expected);
}

/// Two parallel strands of centimetre segments, `gap` apart.
fn two_strands(gap: f64, shift: f64) -> Scene {
    let mut scene = Scene::new(8);
    for strand in 0..2 {
        for i in 0..8 {
            // A slight crossing angle: each pair has one closest place.
            let (i, side) = (f64::from(i), f64::from(strand));
            scene.position.push(Vector3::new(i + side * shift, side * gap, 0.02 * side * (i - 3.5)));
        }
    }
    scene.velocity = vec![Vector3::zeros(); 16];
    scene.inv_mass = vec![4e4; 16];
    scene
}

#[test]
fn a_link_keeps_its_places_and_breaks_by_length_alone() {
    let params = sticky();
    let mut links = LinkSet::default();
    linked(&two_strands(0.2, 0.0).strands(), &mut links, &params);
    let made = links.clone();
    assert!(!made.links().is_empty());
    // Slid along by a quarter of a centimetre: closest places have moved, the links have not.
    linked(&two_strands(0.2, 0.25).strands(), &mut links, &params);
    for link in made.links() {
        let now = links.links().iter().find(|l| (l.i, l.j) == (link.i, link.j)).expect("kept");
        assert_eq!((now.s, now.t), (link.s, link.t));
    }
    // Pressed together hard, none breaks; drawn beyond the limit, all do.
    linked(&two_strands(1e-4, 0.0).strands(), &mut links, &params);
    assert!(made.links().iter().all(|l| links.is_linked(l.i as usize, l.j as usize)));
    linked(&two_strands(0.41, 0.0).strands(), &mut links, &params);
    assert!(links.links().is_empty());
}

/// k/2 l0 (l - l0)² of every link held at fixed places.
fn energy(links: &LinkSet, strands: &Strands, params: &StictionParams) -> f64 {
    let mut springs = Vec::new();
    links.clone().springs(strands, params, &mut springs);
    springs.iter().map(|s| 0.5 * s.tension * s.tension / s.stiffness_per_cm).sum()
}

#[test]
fn spring_forces_are_the_slope_of_their_energy() {
    let mut scene = Scene::tangle(3, 20, 1.0, 0.0);
    let params = sticky();
    let mut links = LinkSet::default();
    linked(&scene.strands(), &mut links, &params);
    let mut springs: Vec<LinkSpring> = Vec::new();
    links.springs(&scene.strands(), &params, &mut springs);
    assert!(springs.len() > 20);
    let mut force = vec![Vector3::<f64>::zeros(); scene.position.len()];
    for s in &springs {
        assert!(s.weights.iter().sum::<f64>().abs() < 1e-15 && (s.direction.norm() - 1.0).abs() < 1e-12);
        for k in 0..4 {
            force[s.particles[k] as usize] -= s.direction * (s.weights[k] * s.tension);
        }
    }
    let largest = force.iter().map(|f| f.norm()).fold(0.0, f64::max);
    for p in (0..scene.position.len()).step_by(7) {
        for c in 0..3 {
            let (x, h) = (scene.position[p][c], 1e-6);
            scene.position[p][c] = x + h;
            let above = energy(&links, &scene.strands(), &params);
            scene.position[p][c] = x - h;
            let below = energy(&links, &scene.strands(), &params);
            scene.position[p][c] = x;
            assert!(((below - above) / (2.0 * h) - force[p][c]).abs() < DERIVATIVE * largest);
        }
    }
}

#[test]
fn coincident_points_still_have_a_direction() {
    let params = sticky();
    let mut links = LinkSet::default();
    linked(&two_strands(0.1, 0.0).strands(), &mut links, &params);
    let mut scene = two_strands(0.1, 0.0);
    let link = links.links()[0];
    let (a, b) = (link.i as usize, link.j as usize + 1);
    for k in 0..2 {
        scene.position[b + k] = scene.position[a + k];
    }
    let mut springs = Vec::new();
    links.springs(&scene.strands(), &params, &mut springs);
    assert!(springs.iter().all(|s| (s.direction.norm() - 1.0).abs() < 1e-12 && s.tension.is_finite()));
    // Links made of strands that already cross exactly.
    let mut crossing = LinkSet::default();
    linked(&two_strands(0.0, 0.0).strands(), &mut crossing, &params);
    crossing.springs(&scene.strands(), &params, &mut springs);
    assert!(!springs.is_empty() && springs.iter().all(|s| (s.direction.norm() - 1.0).abs() < 1e-12));
}

#[test]
fn styles_do_what_their_names_say() {
    let style = |wetness, clumpiness, volume| StictionParams::from_style(&HairStyle { wetness, clumpiness, volume });
    let (dry, wet, clumped, full) =
        (style(0.0, 0.0, 0.0), style(1.0, 0.0, 0.0), style(0.0, 1.0, 0.0), style(0.0, 0.0, 1.0));
    assert!(wet.stiffness > dry.stiffness && wet.mass_factor > dry.mass_factor);
    assert!(clumped.max_links > dry.max_links && clumped.stiffness > dry.stiffness);
    assert!(full.rest_cm > dry.rest_cm && full.stiffness > dry.stiffness);
    for params in [dry, wet, clumped, full, style(1.0, 1.0, 1.0), style(-3.0, f64::NAN, 9.0), StictionParams::off()] {
        params.validate().expect("every style is valid");
    }
    assert!(StictionParams { break_cm: 0.01, ..dry }.validate().is_err());
    assert!(StictionParams { rest_cm: 0.0, ..dry }.validate().is_err());
    assert!(StictionParams { stiffness: f64::NAN, ..dry }.validate().is_err());
    let mut links = LinkSet::default();
    linked(&two_strands(0.05, 0.0).strands(), &mut links, &dry);
    assert!(!links.links().is_empty());
    linked(&two_strands(0.05, 0.0).strands(), &mut links, &StictionParams::off());
    assert!(links.links().is_empty());
}

#[test]
fn links_do_not_depend_on_the_thread_count() {
    let scene = Scene::tangle(4, 1_500, 8.0, 50.0);
    with_any_thread_count(|| {
        let mut links = LinkSet::default();
        linked(&scene.strands(), &mut links, &sticky());
        let mut springs = Vec::new();
        links.springs(&scene.strands(), &sticky(), &mut springs);
        (links, springs)
    });
}
