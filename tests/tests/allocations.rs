//! A warm runtime asks for no memory: counted by an allocator that stands in for the system's, which is why this is a program of its
//! own. Among solids that come and go, while guides are chosen anew and hairs push back.

use adaptive_runtime::{Runtime, RuntimeParams, StepInput};
use collision::{Shape, Solid};
use hair_tests::models::Row;
use nalgebra::{Isometry3, Translation3, Vector3};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// The system's allocator, counting while it is told to.
struct Counting;

static COUNTS: AtomicBool = AtomicBool::new(false);
static ASKED: AtomicU64 = AtomicU64::new(0);

// Every call is handed on as it came, so the system allocator's promises are kept.
#[expect(unsafe_code, reason = "an allocator can only be stood in for by one")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note();
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        note();
        unsafe { System.realloc(at, layout, size) }
    }
}

fn note() {
    if COUNTS.load(Ordering::Relaxed) {
        ASKED.fetch_add(1, Ordering::Relaxed);
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Requests for memory over `work`.
fn asked(work: impl FnOnce()) -> u64 {
    ASKED.store(0, Ordering::Relaxed);
    COUNTS.store(true, Ordering::Relaxed);
    work();
    COUNTS.store(false, Ordering::Relaxed);
    ASKED.load(Ordering::Relaxed)
}

#[test]
fn a_warm_step_and_read_ask_for_no_memory() {
    const ROUND: usize = 80;
    let ball = Shape::sphere(Vector3::zeros(), 0.8).into();
    let ball = Solid::from_shape("ball", &ball, 0.05, 0.8, 0.3).unwrap();
    let rod = Shape::capsule(Vector3::new(-4.0, 0.0, 0.0), Vector3::new(4.0, 0.0, 0.0), 0.15).into();
    let rod = Solid::from_shape("rod", &rod, 0.03, 0.15, 0.3).unwrap();
    // The ball from side to side through the hair, the rod from the front into it and out again.
    let poses = |k: usize| -> [Isometry3<f64>; 2] {
        let t = (k % ROUND) as f64 / ROUND as f64;
        let swing = (std::f64::consts::TAU * t).sin();
        [Translation3::new(4.0 * swing, -9.0, 0.2).into(), Translation3::new(0.0, -14.0, 3.0 - 4.0 * swing).into()]
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        let (model, params) = (Row::parted().model(), RuntimeParams::adaptive());
        let head = Isometry3::identity();
        let mut hair = Runtime::new(model, params, head, None, vec![ball, rod], &poses(0)).unwrap();
        let (mut pushed, mut changed) = (0, 0);
        let mut round = |hair: &mut Runtime| {
            for k in 1..=ROUND {
                let world_from_solids = poses(k);
                let turned = Isometry3::rotation(Vector3::y() * 0.1 * (k as f64 / ROUND as f64 * 6.28).sin());
                let input = StepInput { dt: 0.01, world_from_head: turned, world_from_solids: &world_from_solids };
                let report = hair.step(&input);
                (pushed, changed) = (pushed + report.strands_in_contact, changed + report.set_changes);
                hair.read();
            }
        };
        // What is kept grows as far as it ever will.
        for _ in 0..3 {
            round(&mut hair);
        }
        let asked = asked(|| round(&mut hair));
        assert!(pushed > 0 && changed > 0, "the solids were to meet hair and to part it");
        assert_eq!(asked, 0, "requests for memory in {ROUND} warm steps");
    });
}
