//! Where a strand is near a solid: all places at which its distance is least, from as few samples as will tell.
//!
//! A distance changes by at most the length walked, so the distances at the ends of a stretch bound all between them. Stretches that the
//! bound does not clear are divided: runs of segments by halves, then segments into quarters and quarters again, down to the spacing at which
//! the solid is sampled. Samples of one division are taken together. What is not divided further is surely farther than was asked.

use crate::solid_in_head::{Frame, particle};
use collision::{Samples, SignedDistanceField};
use nalgebra::Vector3;

/// Runs of at most so many segments are marked as one.
const SHORT_RUN: usize = 2;

/// Parts that a segment, and again a part of it, is divided into.
const PARTS: usize = 4;

/// Most divisions: guards against a spacing of zero.
const MOST_DIVISIONS: usize = 4;

/// A place where a strand's distance to a solid is least among its neighbours.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Nearest {
    pub segment: u16,
    pub s: f32,
    /// Signed distance, cm.
    pub distance: f32,
    /// Where that is and the unit normal there, in the solid's frame.
    pub point: [f32; 3],
    pub normal: [f32; 3],
}

/// Buffers of a worker.
#[derive(Clone, Debug, Default)]
pub(crate) struct Look {
    point: [Vec<f32>; 3],
    distance: Vec<f32>,
    gradient: [Vec<f32>; 3],
    /// Samples of the division at work: place along the strand in particles, and index of the sample.
    along: Vec<(f32, u32)>,
    next: Vec<(f32, u32)>,
    /// What was found, root first.
    pub found: Vec<Nearest>,
}

/// The strand and the solid looked at.
#[derive(Clone, Copy)]
pub(crate) struct Sight<'a> {
    pub field: &'a SignedDistanceField,
    pub solid_from_head: Frame,
    /// Particles that count.
    pub first: usize,
    pub end: usize,
    /// Bound on the length of a segment, cm.
    pub longest: f32,
    /// Distance below which places are wanted, cm.
    pub reach: f32,
    /// Distance between samples where the solid is near, cm.
    pub spacing: f32,
}

/// A strand as three arrays of `pad` values, head frame, cm.
#[derive(Clone, Copy)]
pub(crate) struct Particles<'a> {
    pub x: &'a [f32],
    pub pad: usize,
}

impl Sight<'_> {
    /// Particle `i` in the solid's frame.
    #[inline(always)]
    fn at(&self, strand: Particles, i: usize) -> [f32; 3] {
        self.solid_from_head.point(particle(strand.x, strand.pad, i))
    }
}

impl Look {
    /// Marks the segments (bit j: from particle j to the next) that may be nearer than `within` cm; returns a lower bound of the
    /// distance of all others, cm.
    pub(crate) fn marks(sight: &Sight, strand: Particles, within: f32) -> (u64, f32) {
        let bound = |i: usize| sight.field.lower_bound(Vector3::from(sight.at(strand, i)));
        let (mut marked, mut clear) = (0u64, f32::INFINITY);
        // Runs still to be cleared: both ends with their bounds. Halving 64 segments leaves at most seven.
        let mut runs = [(0usize, 0usize, 0.0f32, 0.0f32); 8];
        let last = sight.end - 1;
        runs[0] = (sight.first, last, bound(sight.first), bound(last));
        let mut n_runs = 1;
        while n_runs > 0 {
            n_runs -= 1;
            let (a, b, at_a, at_b) = runs[n_runs];
            // Not a number clears nothing.
            let least = 0.5 * (at_a + at_b - (b - a) as f32 * sight.longest);
            if least > within {
                clear = clear.min(least);
            } else if b - a <= SHORT_RUN {
                marked |= ((1u64 << (b - a)) - 1) << a;
            } else {
                let middle = usize::midpoint(a, b);
                let at_middle = bound(middle);
                runs[n_runs] = (middle, b, at_middle, at_b);
                runs[n_runs + 1] = (a, middle, at_a, at_middle);
                n_runs += 2;
            }
        }
        (marked, clear)
    }

    /// Finds all places of the marked segments nearer than the reach, in `found`; returns a lower bound of the distance of the rest of
    /// them, cm.
    pub(crate) fn at_strand(&mut self, sight: &Sight, strand: Particles, marked: u64) -> f32 {
        self.found.clear();
        self.clear_samples();
        for i in sight.first..sight.end {
            let beside = (marked >> i & 1) | if i > 0 { marked >> (i - 1) & 1 } else { 0 };
            if beside == 1 {
                self.add(i as f32, sight.at(strand, i));
            }
        }
        let mut clear = f32::INFINITY;
        if self.along.is_empty() {
            return clear;
        }
        self.sample(sight.field, 0);
        let mut spacing = sight.longest;
        for _ in 0..MOST_DIVISIONS {
            clear = clear.min(self.divide(sight, marked, spacing));
            spacing /= PARTS as f32;
            if spacing <= sight.spacing {
                break;
            }
        }
        self.keep_least(sight);
        clear
    }

    fn clear_samples(&mut self) {
        self.point.iter_mut().chain(&mut self.gradient).for_each(Vec::clear);
        self.distance.clear();
        self.along.clear();
    }

    #[inline(always)]
    fn add(&mut self, along: f32, p: [f32; 3]) {
        self.along.push((along, self.point[0].len() as u32));
        for c in 0..3 {
            self.point[c].push(p[c]);
        }
    }

    /// Samples all places from `first` on.
    fn sample(&mut self, field: &SignedDistanceField, first: usize) {
        let n = self.point[0].len();
        self.distance.resize(n, 0.0);
        self.gradient.iter_mut().for_each(|g| g.resize(n, 0.0));
        let [x, y, z] = &self.point;
        let [gx, gy, gz] = &mut self.gradient;
        field.sample(
            [&x[first..], &y[first..], &z[first..]],
            &mut Samples {
                distance: &mut self.distance[first..],
                gradient: [&mut gx[first..], &mut gy[first..], &mut gz[first..]],
            },
        );
    }

    /// Divides every stretch between neighbouring samples, at most `spacing` cm long, that may hold something nearer than the reach; returns the
    /// bound of the others.
    fn divide(&mut self, sight: &Sight, marked: u64, spacing: f32) -> f32 {
        let mut clear = f32::INFINITY;
        let first = self.point[0].len();
        let mut next = std::mem::take(&mut self.next);
        next.clear();
        for k in 0..self.along.len() {
            let (t, index) = self.along[k];
            next.push((t, index));
            let Some(&(u, other)) = self.along.get(k + 1) else { break };
            // Between marked segments there is nothing to divide.
            if u - t > 1.0 || marked >> t as u32 & 1 == 0 {
                continue;
            }
            let (i, j) = (index as usize, other as usize);
            let sure = |i: usize| sight.field.surely(self.distance[i]);
            let least = 0.5 * (sure(i) + sure(j) - spacing);
            if least > sight.reach {
                clear = clear.min(least);
                continue;
            }
            for part in 1..PARTS {
                let share = part as f32 / PARTS as f32;
                let mut p = [0.0; 3];
                for c in 0..3 {
                    p[c] = self.point[c][i] + (self.point[c][j] - self.point[c][i]) * share;
                }
                next.push((t + (u - t) * share, self.point[0].len() as u32));
                for c in 0..3 {
                    self.point[c].push(p[c]);
                }
            }
        }
        std::mem::swap(&mut self.along, &mut next);
        self.next = next;
        if self.point[0].len() > first {
            self.sample(sight.field, first);
        }
        clear
    }

    /// Keeps the samples that no neighbour is nearer than.
    fn keep_least(&mut self, sight: &Sight) {
        for k in 0..self.along.len() {
            let (t, index) = self.along[k];
            let i = index as usize;
            let distance = self.distance[i];
            if distance >= sight.reach || distance.is_nan() {
                continue;
            }
            let nearer = |other: Option<&(f32, u32)>, or_equal: bool| {
                other.is_some_and(|&(u, j)| {
                    let d = self.distance[j as usize];
                    (u - t).abs() <= 1.0 && (d < distance || (or_equal && d == distance))
                })
            };
            if nearer(k.checked_sub(1).and_then(|k| self.along.get(k)), true) || nearer(self.along.get(k + 1), false) {
                continue;
            }
            let gradient = [self.gradient[0][i], self.gradient[1][i], self.gradient[2][i]];
            let length2 = gradient[0] * gradient[0] + gradient[1] * gradient[1] + gradient[2] * gradient[2];
            let point = [self.point[0][i], self.point[1][i], self.point[2][i]];
            let normal = if length2 > LEAST_SLOPE2 {
                let scale = 1.0 / length2.sqrt();
                [gradient[0] * scale, gradient[1] * scale, gradient[2] * scale]
            } else {
                sight.field.outward_normal(Vector3::from(point)).1.into()
            };
            let segment = (t as usize).min(sight.end - 2);
            self.found.push(Nearest { segment: segment as u16, s: t - segment as f32, distance, point, normal });
        }
    }
}

/// Square of the slope below which a sample has no direction of its own.
const LEAST_SLOPE2: f32 = 1e-4;
