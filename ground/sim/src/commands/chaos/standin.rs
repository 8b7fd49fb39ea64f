//! A network written by hand: it steers by the depth image through the widest sector toward the goal. It takes a tenth
//! of the policy's time, and the flight logic does not know the difference.

use goshawk_core::{ANCHORS, MAX_CHANNELS, NetworkOutput};
use goshawk_policy::{Contract, PolicyError};

use crate::trial::onboard::Network;

/// The stand-in's contract, as a policy's file holds it.
#[must_use]
pub fn contract_json(task: &str) -> String {
    let channels = if task == "track" { r#","objectness","du","dv","distance""# } else { "" };
    format!(
        r#"{{"version":2,"task":"{task}","image":{{"width":160,"height":96,"hfov_rad":1.5707963,"vfov_rad":1.0808390}},
        "depth":{{"min_m":0.2,"max_m":20.0,"fill_passes":2}},"lattice":{{"rows":3,"columns":5,"radius_m":5.0,
        "elevation_offset_rad":0.2618,"azimuth_offset_rad":0.2618}},"v_max_mps":6.0,"a_max_mps2":6.0,
        "duration_rule":"2r/(alpha*v_max)","target_depth_scale_m":5.0,"cost_scale":6.0,"state":["velocity","acceleration","up","aim","agility"],
        "channels":["theta","phi","r","vx","vy","vz","ax","ay","az","cost"{channels}],"camera_tilt_rad":0.17,
        "training":{{}}}}"#
    )
}

/// Steers through the widest sector of the depth image towards the goal, at the goal's height.
pub struct Sectors {
    /// What it says of itself.
    pub contract: Contract,
    /// Takes every sector for free.
    pub blind: bool,
}

impl Network for Sectors {
    fn contract(&self) -> &Contract {
        &self.contract
    }

    fn infer(&mut self, rgbd: &[f32], state: &[f32]) -> Result<NetworkOutput, PolicyError> {
        let mut values = [0.0f32; MAX_CHANNELS * ANCHORS];
        values[9 * ANCHORS..10 * ANCHORS].fill(50.0);
        let depth = &rgbd[3 * 96 * 160..];
        let (up, aim) = (&state[6..9], &state[9..12]);
        let length = aim.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-6);
        let climb = (aim[0] * up[0] + aim[1] * up[1] + aim[2] * up[2]) / length;
        let aim_azimuth = aim[1].atan2(aim[0]);
        for column in 0..5usize {
            let azimuth = std::f32::consts::FRAC_PI_2 * (0.5 - (column as f32 + 0.5) / 5.0);
            let (left, right) = ((32 * column).saturating_sub(16), (32 * column + 48).min(160));
            let free = (20..70)
                .flat_map(|row| (left..right).map(move |u| row * 160 + u))
                .map(|i| 20.0 * depth[i])
                .fold(20.0f32, f32::min);
            let free = if self.blind { 20.0 } else { free };
            // The elevation in the camera that has the aim's climb in the world.
            let mut elevation = 0.0f32;
            for _ in 0..4 {
                let level = azimuth.cos() * up[0] + azimuth.sin() * up[1];
                let value = elevation.cos() * level + elevation.sin() * up[2] - climb;
                elevation -= value / (elevation.cos() * up[2] - elevation.sin() * level).max(0.3);
            }
            let index = 5 + column;
            let reach = (free - 1.0).clamp(1.0, 6.0);
            values[index] = (elevation / 0.2618).clamp(-0.95, 0.95).atanh();
            values[2 * ANCHORS + index] = ((reach - 5.0) / 5.0).atanh();
            values[3 * ANCHORS + index] = (0.1 * reach * elevation.cos()).atanh();
            values[5 * ANCHORS + index] = (0.1 * reach * elevation.sin()).atanh();
            values[9 * ANCHORS + index] = (azimuth - aim_azimuth).abs() + 3.0 * (4.0 - free).max(0.0);
        }
        Ok(NetworkOutput { values })
    }
}
