//! Neither step function allocates after construction. A test binary of its own: it replaces the allocator.
#![allow(
    unsafe_code,
    reason = "counting allocations means implementing GlobalAlloc, which forwards to System unchanged"
)]

mod common;

use common::{Frames, Loop};
use goshawk_core::planning::nearest::{COLUMNS, ROWS};
use goshawk_core::*;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call is forwarded to `System` with the same arguments; counting touches only a thread-local integer.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations() -> u64 {
    ALLOCATIONS.with(Cell::get)
}

#[test]
fn a_whole_flight_of_controller_steps_allocates_nothing() {
    let mut sim = Loop::new();
    sim.transitions.reserve(64);
    sim.requests.reserve(64);
    let before = allocations();
    sim.frames = Frames::Target(Vec3::new(15.0, 0.0, 1.5));
    sim.start(common::track());
    sim.run(8.0);
    // Odometry that jumps, is doubted, and is believed again.
    sim.odometry_offset = Vec3::x() * 5.0;
    sim.velocity_offset = Vec3::y() * 3.0;
    sim.run(0.1);
    assert_eq!(sim.out().odometry_fault, Some(OdometryFault::VelocityStepped));
    sim.velocity_offset = Vec3::zeros();
    sim.run(1.3);
    assert_eq!(sim.out().odometry_fault, None);
    sim.frames = Frames::None;
    sim.run(3.0);
    sim.stop();
    sim.run(12.0);
    assert_eq!(allocations() - before, 0);
    assert!(sim.transitions.len() > 5, "it flew: {:?}", sim.transitions);
    drop(std::hint::black_box(vec![1]));
    assert!(allocations() > before, "the counter counts");
}

#[test]
fn planner_steps_allocate_nothing() {
    let mut planner = Planner::new(common::planner_config(Task::Track)).unwrap();
    let mut network = NetworkOutput { values: [0.3; MAX_CHANNELS * ANCHORS] };
    network.values[10 * ANCHORS + 7] = 4.0; // the target's cell
    let odometry = common::odometry();
    let before = allocations();
    let mut chosen = 0;
    for seq in 0..100 {
        network.values[0] = seq as f32 * 0.01;
        let odometry = Odometry { stamp: Time::from_secs(seq as f64 / 30.0), ..odometry };
        let frame = FrameInput { nearest: [3000 + seq as u16; COLUMNS * ROWS], ..common::frame(seq, odometry) };
        chosen += usize::from(planner.see(&frame).answer(&network).chosen.is_some());
    }
    assert_eq!(allocations() - before, 0);
    assert!(chosen > 90);
}
