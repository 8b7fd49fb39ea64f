//! The autopilot stand-in with a quadrotor in still air, in real time, until stdin closes. Prints its port.
//!
//! ```text
//! cargo run --release -p goshawk-sim --example px4 -- 127.0.0.1:14580 127.0.0.1:14540
//! ```

use goshawk_core::{Time, Vec3};
use goshawk_sim::vehicle::imu::ImuSample;
use goshawk_sim::vehicle::px4::{Px4Config, Px4Udp, VehicleState};
use goshawk_sim::vehicle::quadrotor::{Quadrotor, QuadrotorParameters, STEP_S};
use std::error::Error;
use std::io::Read;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

fn main() -> Result<(), Box<dyn Error>> {
    let mut addresses = std::env::args().skip(1);
    let bind = addresses.next().ok_or("usage: px4 BIND [REMOTE], such as 127.0.0.1:14580 127.0.0.1:14540")?.parse()?;
    let remote = addresses.next().map(|remote| remote.parse()).transpose()?;
    let parameters = QuadrotorParameters::default();
    let config = Px4Config { loss_s: 0.5, hover_thrust: parameters.hover_thrust, ..Px4Config::default() };
    let mut px4 = Px4Udp::open(config, bind, remote)?;
    println!("{}", px4.local_address()?.port());

    let closed = Arc::new(AtomicBool::new(false));
    let for_thread = Arc::clone(&closed);
    std::thread::spawn(move || {
        // The end of input, or its failure, both mean that nobody is there any more.
        let _ = std::io::stdin().read_to_end(&mut Vec::new());
        for_thread.store(true, Ordering::Relaxed);
    });

    let mut quadrotor = Quadrotor::new(parameters, Vec3::new(0.0, 0.0, 0.06), 0.0);
    let start = Instant::now();
    for step in 1.. {
        if closed.load(Ordering::Relaxed) {
            break;
        }
        let now = Time::from_secs(f64::from(step) * STEP_S);
        let state = quadrotor.state();
        let vehicle = VehicleState {
            pos_world: state.pos_world,
            vel_world: state.vel_world,
            world_from_body: state.world_from_body,
            ang_vel_body: state.ang_vel_body,
            imu: ImuSample::ideal(state),
            on_ground: state.on_ground,
            battery_fraction: quadrotor.battery_fraction(),
            reset_counter: 0,
        };
        let output = px4.poll(now, &vehicle);
        quadrotor.step(STEP_S, output.demand.as_ref(), Vec3::zeros(), |_, _| 0.0);
        std::thread::sleep(Duration::from_nanos(now.0).saturating_sub(start.elapsed()));
    }
    Ok(())
}
