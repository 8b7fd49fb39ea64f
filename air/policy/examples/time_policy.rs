//! Loads a policy, prints what its contract says and how long a frame takes on one thread:
//! `cargo run --release -p goshawk-policy --example time_policy -- FILE.onnx [WIDTH HEIGHT]`.

use std::error::Error;
use std::path::Path;
use std::time::{Duration, Instant};

use goshawk_policy::{Policy, Preprocessor, Source};

const FRAMES: usize = 500;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let path = arguments.first().ok_or("usage: time_policy FILE.onnx [WIDTH HEIGHT]")?;
    let mut policy = Policy::load(Path::new(path), None, 1)?;
    let contract = policy.contract().clone();
    println!("sha256   {}", policy.sha256());
    println!("task     {:?}, v_max {} m/s, trained on {:?}", contract.task, contract.v_max_mps, contract.training);

    let (width, height) = match &arguments[1..] {
        [width, height] => (width.parse()?, height.parse()?),
        _ => (160, 96),
    };
    let image = contract.image;
    let source = Source { width, height, hfov_rad: image.hfov_rad, vfov_rad: image.vfov_rad };
    let mut preprocessor = Preprocessor::new(&contract, source)?;
    let pixels = width as usize * height as usize;
    let rgb: Vec<u8> = (0..3 * pixels).map(|i| (i * 31 % 251) as u8).collect();
    let depth: Vec<u16> = (0..pixels).map(|i| (i * 7919 % 25_000) as u16).collect();
    let state = vec![0.1; policy.state_len()];

    let mut preparing = Vec::new();
    let mut inferring = Vec::new();
    for _ in 0..FRAMES {
        let start = Instant::now();
        let rgbd = preprocessor.run(&rgb, &depth)?;
        let prepared = Instant::now();
        policy.infer(rgbd, &state)?;
        preparing.push(prepared - start);
        inferring.push(prepared.elapsed());
    }
    report("prepare", preparing);
    report("infer", inferring);
    Ok(())
}

fn report(name: &str, mut times: Vec<Duration>) {
    times.sort();
    let us = |share: f64| times[((times.len() - 1) as f64 * share) as usize].as_secs_f64() * 1e6;
    println!("{name:8} p50 {:8.1} us   p99 {:8.1} us", us(0.5), us(0.99));
}
