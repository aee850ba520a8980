//! Choices driven by events against choices made by looking at every hair plainly, and what a set must be.

use super::*;
use crate::offset::Return;
use crate::params::RuntimeParams;
use crate::strands::Fade;
use crate::test_model::{Noise, lattice};
use io_formats::guide_transform::{Blend, DisplacementTransform, guide_transforms};

/// Single-precision rounding over coordinates of some tens of centimetres.
const ROUND_OFF_CM: f64 = 2e-5;

const STEPS: usize = 60;

/// Time of a choice, s; how offsets return.
const NOW: f64 = 3.0;
const RATE: f64 = 5.0;
const REST_CM: f64 = 1e-4;

struct Scene {
    model: SkinningModel,
    graph: GuideGraph,
    clusters: Clusters,
    transforms: TransformArrays,
    plain_transforms: Vec<Vec<DisplacementTransform>>,
    sets: Vec<u16>,
    /// Offsets, each hair in the slot of its number: half of the hairs carry none.
    fades: Vec<Fade>,
    carried: Vec<f32>,
    slot_of: Vec<u32>,
}

impl Scene {
    fn new(blend: Blend) -> Self {
        let model = lattice(7, 4, 13, 300, blend);
        let graph = GuideGraph::new(&model);
        let n = model.n_particles as usize;
        Self {
            clusters: Clusters::new(&graph),
            transforms: TransformArrays::new(model.n_guides(), n, blend),
            plain_transforms: vec![vec![DisplacementTransform::default(); n]; model.n_guides()],
            sets: (0..model.n_strands as usize).map(|s| best_set(&model, s)).collect(),
            fades: Vec::new(),
            carried: Vec::new(),
            slot_of: (0..model.n_strands).collect(),
            graph,
            model,
        }
    }

    /// Guides sway, and edges come and go: a plane sweeps over the head and parts what is on its two sides.
    fn move_to(&mut self, step: usize) {
        let n = self.model.n_particles as usize;
        let mut noise = Noise::new(step as u64 + 1);
        for g in 0..self.model.n_guides() {
            let rest = self.model.rest_of(g).to_vec();
            let swing = 0.6 + 0.4 * (0.3 * g as f32).sin();
            let now: Vec<[f32; 3]> = (0..n)
                .map(|i| {
                    let s = i as f32 / (n - 1) as f32;
                    let phase = 0.2 * step as f32;
                    [rest[i][0] + swing * s * s * phase.sin(), rest[i][1], rest[i][2] + 0.4 * swing * s * phase.cos()]
                })
                .collect();
            guide_transforms(&rest, &now, self.model.blend, &mut self.plain_transforms[g]);
            self.transforms.set_guide(g, &self.plain_transforms[g]);
        }
        let plane = 9.0 * (0.1 * step as f32).sin();
        let side = |g: u16| self.model.rest_of(usize::from(g))[0][0] < plane;
        let edges: Vec<bool> =
            self.model.pairs.iter().map(|&[i, j]| side(i) == side(j) && noise.next() > 0.02).collect();
        self.graph.set_edges(&self.model, &edges);
        self.hold_off(&mut noise);
    }

    /// Every second hair has been held off by something lately, by up to half a centimetre at its tip.
    fn hold_off(&mut self, noise: &mut Noise) {
        let (n, pad) = (self.model.n_particles as usize, self.transforms.pad);
        self.fades.clear();
        self.carried.clear();
        for s in 0..self.sets.len() {
            let push: [f32; 3] = std::array::from_fn(|_| noise.next() - 0.5);
            let at = |c: usize, i: usize| push[c] * (i.min(n - 1) as f32 / (n - 1) as f32);
            let mut offset: Vec<f32> = (0..3 * pad).map(|k| at(k / pad, k % pad)).collect();
            offset.resize(6 * pad, 0.0);
            let (x, v) = offset.split_at(3 * pad);
            let fade = if s % 2 == 0 { Fade::NONE } else { Fade::of(x, v, pad, NOW - 0.05, RATE, REST_CM) };
            self.fades.push(fade);
            self.carried.extend(offset);
        }
    }

    fn offsets(&self) -> Offsets<'_> {
        let Self { slot_of, fades, carried, .. } = self;
        let n_particles = self.model.n_particles as usize;
        Offsets {
            slot_of,
            fades,
            carried,
            n_particles,
            pad: self.transforms.pad,
            time: NOW,
            rate: RATE,
            least_cm: REST_CM,
        }
    }

    /// By how much a hair is held off its guides at each particle, by the spring's closed form.
    fn held_off(&self, s: usize) -> Vec<[f64; 3]> {
        let (n, pad) = (self.model.n_particles as usize, self.transforms.pad);
        let back = Return::over(NOW - self.fades[s].stamp, RATE);
        let value = |c: usize, i: usize| f64::from(back.value(self.carried[s * 6 * pad + c * pad + i], 0.0));
        let carries = self.fades[s].carries(NOW);
        (0..n).map(|i| std::array::from_fn(|c| if carries { value(c, i) } else { 0.0 })).collect()
    }

    fn apply(&mut self, changes: &[SetChange]) {
        for change in changes {
            self.sets[change.strand as usize] = change.set;
        }
    }

    fn mask(&self, s: usize) -> u16 {
        self.model.sets_of(s).masks[usize::from(self.sets[s])]
    }

    /// A hair under a set, by the plain equation.
    fn skinned(&self, s: usize, set: u16, weights: WeightRule) -> Vec<[f64; 3]> {
        let n = self.model.n_particles as usize;
        let set = decode(&self.model, s, set, weights);
        (0..n)
            .map(|i| {
                let w = set.weights_at(i as f32 / (n - 1) as f32);
                let mut p = [0.0; 3];
                for b in 0..usize::from(set.n) {
                    let moved = self.plain_transforms[usize::from(set.guides[b])][i].apply(self.model.rest_of(s)[i]);
                    (0..3).for_each(|c| p[c] += f64::from(w[b] * moved[c]));
                }
                p
            })
            .collect()
    }

    /// Of a set from the present one, or from where the hair is held.
    fn shift(&self, s: usize, set: u16, weights: WeightRule) -> f64 {
        self.shift_from(s, set, weights, None)
    }

    fn shift_from(&self, s: usize, set: u16, weights: WeightRule, held_off: Option<&[[f64; 3]]>) -> f64 {
        let (mut a, b) = (self.skinned(s, self.sets[s], weights), self.skinned(s, set, weights));
        for (p, d) in a.iter_mut().zip(held_off.into_iter().flatten()) {
            (0..3).for_each(|c| p[c] += d[c]);
        }
        let squared = |(p, q): (&[f64; 3], &[f64; 3])| (0..3).map(|c| (p[c] - q[c]).powi(2)).sum::<f64>();
        (a.iter().zip(&b).map(squared).sum::<f64>() / a.len() as f64).sqrt()
    }

    fn is_clique(&self, s: usize, mask: u16) -> bool {
        let guides: Vec<usize> = bits(mask).map(|b| usize::from(self.model.eligible_of(s)[b])).collect();
        guides.iter().all(|&a| guides.iter().all(|&b| a == b || self.graph.has_edge(a, b)))
    }

    /// What a hair changes to, read off the rule with all masks tried and all shifts taken plainly.
    fn choose_plainly(&self, s: usize, params: &AssignParams, is_turn: bool) -> Option<u16> {
        let sets = self.model.sets_of(s);
        let full = (1u16 << self.model.eligible_of(s).len()) - 1;
        let cliques: Vec<u16> = (1..=full).filter(|&m| self.is_clique(s, m)).collect();
        let maximal = cliques.iter().copied().filter(|&m| !cliques.iter().any(|&c| c != m && c & m == m));
        let current = self.mask(s);
        let error = |set: u16| sets.rms_error_cm[usize::from(set)];
        let stand_in = |mask: u16| sets.stand_in[usize::from(mask) - 1];
        if self.is_clique(s, current) {
            let best =
                maximal.filter(|m| m & current == current).map(stand_in).min_by(|&a, &b| error(a).total_cmp(&error(b)));
            return best.filter(|&b| {
                is_turn
                    && error(b) < error(self.sets[s])
                    && self.shift(s, b, params.weights) <= f64::from(params.growth_tolerance_cm)
            });
        }
        let mut candidates: Vec<u16> =
            maximal.flat_map(|m| [m, m & current]).filter(|&m| m != 0).map(stand_in).collect();
        candidates.sort_unstable();
        let gain = f64::from(params.leave_gain_cm);
        let held_off = (gain >= 0.0).then(|| self.held_off(s));
        let cost = |set: u16| self.shift_from(s, set, params.weights, held_off.as_deref());
        let moves: Vec<f64> = candidates.iter().map(|&c| cost(c)).collect();
        let least = moves.iter().copied().fold(f64::INFINITY, f64::min);
        if gain >= 0.0 && least + gain >= cost(self.sets[s]) {
            return None;
        }
        let near = candidates.iter().zip(&moves).filter(|&(_, m)| *m <= least + f64::from(params.cost_tolerance_cm));
        near.map(|(&c, _)| c).min_by(|&a, &b| error(a).total_cmp(&error(b)))
    }
}

#[test]
fn events_choose_what_looking_at_every_hair_plainly_would() {
    for (blend, weights) in [
        (Blend::Translation, WeightRule::Trained),
        (Blend::Rigid, WeightRule::Trained),
        (Blend::Translation, WeightRule::Distance),
    ] {
        // Broken sets that are kept are looked at in turn: by looking at every hair plainly that is seen with a period of one only.
        for (growth_period, leave_gain_cm) in [(1, -1.0), (8, -1.0), (100, -1.0), (1, 1e-3), (1, 0.02)] {
            let leaves_at_once = leave_gain_cm < 0.0;
            let params = AssignParams {
                growth_period,
                leave_gain_cm,
                weights,
                // Small enough to refuse some.
                growth_tolerance_cm: 0.02,
                cost_tolerance_cm: 0.01,
                ..RuntimeParams::adaptive().assign
            };
            let mut scene = Scene::new(blend);
            let mut assignment = Assignment::new(&scene.model, &scene.graph);
            let (mut n_changes, mut n_grown, mut n_parted) = (0, 0, 0);
            for step in 0..STEPS {
                scene.move_to(step);
                let expected: Vec<SetChange> = (0..scene.sets.len())
                    .filter_map(|s| {
                        let turn = is_turn(step as u64, s as u64, growth_period);
                        let set = scene.choose_plainly(s, &params, turn)?;
                        Some(SetChange { strand: s as u32, set })
                    })
                    .collect();
                // Hairs that are not asked for would not change.
                let offsets = (!leaves_at_once).then(|| scene.offsets());
                assignment.ask(&scene.model, &mut scene.graph.clone(), &params, offsets);
                let found = assignment
                    .update(
                        &scene.model,
                        &scene.graph,
                        &scene.clusters,
                        &scene.transforms,
                        &params,
                        offsets,
                        step as u64,
                        &scene.sets,
                    )
                    .to_vec();
                assert_eq!(found, expected, "step {step}, period {growth_period}, gain {leave_gain_cm}");
                n_changes += found.len();
                n_grown +=
                    found.iter().filter(|c| scene.is_clique(c.strand as usize, scene.mask(c.strand as usize))).count();
                scene.apply(&found);
                let parted = (0..scene.sets.len()).filter(|&s| !scene.is_clique(s, scene.mask(s))).count();
                assert!(!leaves_at_once || parted == 0, "{parted} strands follow guides that are parted");
                n_parted += parted;
            }
            assert!(n_changes > if leaves_at_once { 500 } else { 100 }, "little happened: {n_changes} changes");
            assert!(leaves_at_once || n_parted > 100, "all was left: {n_parted} times a hair stayed");
            assert!(growth_period > 8 || n_grown > if leaves_at_once { 100 } else { 20 }, "little grew: {n_grown}");
        }
    }
}

#[test]
fn shifts_along_vectors_are_those_of_the_plain_equation() {
    for blend in [Blend::Translation, Blend::Rigid] {
        let mut scene = Scene::new(blend);
        scene.move_to(7);
        let lanes = Lanes::new(scene.model.n_particles as usize, scene.transforms.pad);
        let of = (&scene.model, WeightRule::Trained);
        let mut shift = Shift::default();
        let mut largest: f64 = 0.0;
        for s in 0..scene.sets.len() {
            shift.begin(of, &lanes, &scene.transforms, (s, scene.sets[s]));
            for set in 0..scene.model.sets_of(s).masks.len() as u16 {
                let found = f64::from(shift.to(of, &lanes, &scene.transforms, (s, set)));
                let expected = scene.shift(s, set, WeightRule::Trained);
                assert!((found - expected).abs() < ROUND_OFF_CM, "{found} for {expected}");
                largest = largest.max(expected);
            }
        }
        assert!(largest > 0.05, "nothing moved: {largest}");
    }
}

#[test]
fn choices_are_the_same_for_any_number_of_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut scene = Scene::new(Blend::Translation);
            let mut assignment = Assignment::new(&scene.model, &scene.graph);
            let params = AssignParams { leave_gain_cm: -1.0, ..RuntimeParams::adaptive().assign };
            (0..STEPS)
                .map(|step| {
                    scene.move_to(step);
                    let (model, graph) = (&scene.model, &scene.graph);
                    let of = (&scene.clusters, &scene.transforms);
                    let found =
                        assignment.update(model, graph, of.0, of.1, &params, None, step as u64, &scene.sets).to_vec();
                    scene.apply(&found);
                    found
                })
                .collect::<Vec<_>>()
        })
    };
    let one = run(1);
    assert!(one.iter().any(|c| c.len() > 2 * LEAST_PER_WORKER), "too few changes to share among workers");
    for threads in [2, 8] {
        assert_eq!(run(threads), one);
    }
}

#[test]
fn to_the_letter_a_set_lies_within_a_grown_clique_and_moves_the_hair_least() {
    let params = RuntimeParams::paper().assign;
    let mut scene = Scene::new(Blend::Translation);
    let mut assignment = Assignment::new(&scene.model, &scene.graph);
    let mut n_changes = 0;
    for step in 0..STEPS {
        scene.move_to(step);
        scene.clusters.update(&scene.graph);
        let of = (&scene.model, &scene.graph);
        let found = assignment
            .update(of.0, of.1, &scene.clusters, &scene.transforms, &params, None, step as u64, &scene.sets)
            .to_vec();
        n_changes += found.len();
        for change in &found {
            let s = change.strand as usize;
            assert!(!scene.is_clique(s, scene.mask(s)), "a set that holds was left");
            let eligible = scene.model.eligible_of(s);
            let within_one = |mask: u16| {
                (0..scene.clusters.n())
                    .any(|c| bits(mask).all(|b| scene.clusters.contains(c, usize::from(eligible[b]))))
            };
            let masks = scene.model.sets_of(s).masks;
            assert!(within_one(masks[usize::from(change.set)]));
            let moved = scene.shift(s, change.set, params.weights);
            for (k, _) in masks.iter().enumerate().filter(|&(_, &m)| within_one(m)) {
                assert!(moved <= scene.shift(s, k as u16, params.weights) + ROUND_OFF_CM);
            }
        }
        scene.apply(&found);
        assert!((0..scene.sets.len()).all(|s| scene.is_clique(s, scene.mask(s))));
    }
    assert!(n_changes > 300, "little happened: {n_changes} changes");
}

#[test]
fn distance_weights_are_reciprocal_distances_at_root_middle_and_tip() {
    /// Rounding of a quadratic through values of at most one.
    const ROUND_OFF: f32 = 1e-5;
    let scene = Scene::new(Blend::Translation);
    let model = &scene.model;
    let n = model.n_particles as usize;
    for s in 0..model.n_strands as usize {
        let eligible = model.eligible_of(s);
        let weights = distance_weights::distance_weights(model, s, eligible);
        for i in 0..n {
            let u = i as f32 / (n - 1) as f32;
            let sum: f32 = weights.iter().map(|w| w.at(u)).sum();
            assert!((sum - 1.0).abs() < ROUND_OFF, "{sum}");
        }
        if s < model.n_guides() {
            let own = eligible.iter().position(|&g| usize::from(g) == s).unwrap();
            assert!(weights[own].at(0.3) > 0.999, "a guide's own strand is to follow it");
            continue;
        }
        for i in [0, (n - 1) / 2, n - 1] {
            let distance = |g: u16| {
                let (p, q) = (model.rest_of(s)[i], model.rest_of(usize::from(g))[i]);
                (0..3).map(|c| (p[c] - q[c]).powi(2)).sum::<f32>().sqrt()
            };
            for (a, &ga) in eligible.iter().enumerate() {
                for (b, &gb) in eligible.iter().enumerate() {
                    let at = |k: usize| weights[k].at(i as f32 / (n - 1) as f32);
                    // w_a / w_b = d_b / d_a, cross-multiplied.
                    let [left, right] = [at(a) * distance(ga), at(b) * distance(gb)];
                    assert!((left - right).abs() < 1e-4 * left.max(1.0), "{left} and {right}");
                }
            }
        }
    }
}

#[test]
fn turns_of_a_word_are_those_of_its_hairs() {
    for period in [1, 3, 8, 64, 100] {
        for step in [0, 1, 7, 1000] {
            for word in [0, 1, 5] {
                let turns = turn_of_word(step, word, period);
                for bit in 0..64 {
                    assert_eq!(turns >> bit & 1 == 1, is_turn(step, (64 * word + bit) as u64, period));
                }
            }
        }
    }
}
