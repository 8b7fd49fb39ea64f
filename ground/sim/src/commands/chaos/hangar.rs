//! What schedules are flown with: the vehicle of each setting, the scenes, the networks.

use std::path::PathBuf;
use std::sync::{Mutex, OnceLock, PoisonError};

use color_eyre::eyre::{Result, WrapErr, bail, eyre};
use goshawk_core::Task as CoreTask;
use goshawk_policy::{Contract, Policy};
use goshawk_proto::v1;
use goshawk_vehicle::config::Vehicle;

use super::bug::Bug;
use super::draw::SCENES;
use super::flight::{Flown, Ground, fly};
use super::schedule::{Odometry, OnStop, Schedule, Setting, Task};
use super::standin::{Sectors, contract_json};
use crate::actors::evader::Course;
use crate::commands::fly::log::header;
use crate::sense::rgbd::mix;
use crate::trial::scene::SceneConfig;
use crate::trial::{Network, Scene, WorldSource};

/// Trees this far apart, m: open enough for flights to end by their faults.
const SPACING_M: f64 = 7.0;
const GOAL_M: f64 = 8.0;
/// The evader's way, and the size of the scene, m.
const DISTANCE_M: f64 = 24.0;
const SPEED_MPS: f64 = 4.0;
const TARGET_MPS: f64 = 3.0;
const MAX_SPEED_MPS: f64 = 7.0;
const HEIGHT_M: f64 = 1.5;
/// Seeds of the scenes.
const SCENE_SEED: u64 = 4200;

/// All that flights share, made when it is first needed.
pub struct Hangar {
    text: String,
    tuning: String,
    path: PathBuf,
    model: PathBuf,
    library: Option<PathBuf>,
    contract: Contract,
    navigate: [OnceLock<Scene>; SCENES],
    track: [OnceLock<Scene>; SCENES],
    policies: Mutex<Vec<Policy>>,
    /// What is put wrong around the controller.
    pub bug: Option<Bug>,
}

impl Hangar {
    /// With the vehicle file `path`.
    ///
    /// # Errors
    /// It cannot be read, or not be flown with.
    pub fn new(path: PathBuf, bug: Option<Bug>) -> Result<Self> {
        let vehicle = Vehicle::load(&path)?;
        let contract = Contract::from_json(&contract_json("navigate")).wrap_err("the stand-in's contract")?;
        Ok(Self {
            text: vehicle.text.clone(),
            tuning: vehicle.tuning_text.clone(),
            model: vehicle.resolve(&vehicle.policy.model),
            library: vehicle.library(),
            path,
            contract,
            navigate: Default::default(),
            track: Default::default(),
            policies: Mutex::default(),
            bug,
        })
    }

    /// The vehicle of a setting: the file with its fence, its ceiling, what its Stop does, and one profile.
    fn vehicle(&self, setting: &Setting) -> Result<Vehicle> {
        let (mut table, mut tuning): (toml::Table, toml::Table) = (self.text.parse()?, self.tuning.parse()?);
        set(&mut table, "limits", "fence_radius_m", setting.fence_m.into());
        set(&mut table, "limits", "ceiling_m", setting.ceiling_m.into());
        set(&mut table, "limits", "max_speed_mps", MAX_SPEED_MPS.into());
        let on_stop = match setting.on_stop {
            OnStop::Land => "land",
            OnStop::Hover => "hover",
            OnStop::HandOver => "hand-over",
        };
        set(&mut tuning, "mission", "on_stop", on_stop.into());
        let odometry = match setting.odometry {
            Odometry::Autopilot => "autopilot",
            Odometry::Zenoh => "zenoh",
        };
        set(&mut table, "sensors", "odometry", odometry.into());
        // What the file says of another source, or of its own profiles, is not of this vehicle.
        for (section, key) in [("autopilot", "vision"), ("switch", "profile")] {
            if let Some(section) = table.get_mut(section).and_then(toml::Value::as_table_mut) {
                section.remove(key);
            }
        }
        let mut profile = toml::Table::new();
        profile.insert("name".to_owned(), "chaos".into());
        profile.insert("speed_mps".to_owned(), SPEED_MPS.into());
        profile.insert("height_m".to_owned(), HEIGHT_M.into());
        match setting.task {
            Task::Track => profile.insert("task".to_owned(), "track".into()),
            Task::Navigate => {
                profile.insert("goal_m".to_owned(), vec![GOAL_M, 0.0, HEIGHT_M].into());
                profile.insert("task".to_owned(), "navigate".into())
            }
        };
        table.insert("profile".to_owned(), vec![toml::Value::Table(profile)].into());
        table.insert("default_profile".to_owned(), "chaos".into());
        Ok(Vehicle::parse(toml::to_string(&table)?, toml::to_string(&tuning)?, &self.path)?)
    }

    fn scene(&self, setting: &Setting) -> Result<&Scene> {
        let (task, scenes) = match setting.task {
            Task::Track => (CoreTask::Track, &self.track),
            Task::Navigate => (CoreTask::Navigate, &self.navigate),
        };
        let slot = &scenes[setting.scene % SCENES];
        if let Some(scene) = slot.get() {
            return Ok(scene);
        }
        let world = WorldSource::Forest { spacing_m: SPACING_M };
        let seed = mix(SCENE_SEED, (setting.scene % SCENES) as u64);
        let config = SceneConfig::of_task(task, TARGET_MPS, world, Course::Goal, seed);
        let scene = Scene::new(&SceneConfig { distance_m: DISTANCE_M, ..config })?;
        Ok(slot.get_or_init(|| scene))
    }

    /// Flies a schedule.
    ///
    /// # Errors
    /// It cannot be flown at all.
    pub fn fly(&self, schedule: &Schedule) -> Result<Flown> {
        let vehicle = self.vehicle(&schedule.setting)?;
        let scene = self.scene(&schedule.setting)?;
        let header = |policy| v1::LogHeader { profile: "chaos".to_owned(), ..header(&vehicle, policy) };
        let ground = |header| Ground { vehicle: &vehicle, scene, header, bug: self.bug };
        if schedule.setting.task == Task::Navigate {
            let header = v1::LogHeader { policy_contract_json: contract_json("navigate"), ..header(None) };
            let mut network = Sectors { contract: self.contract.clone(), blind: false };
            return Ok(fly(schedule, &ground(&header), &mut network as &mut dyn Network)?);
        }
        let mut policy = self.policy()?;
        let header = header(Some(&policy));
        let flown = fly(schedule, &ground(&header), &mut policy as &mut dyn Network);
        self.policies.lock().unwrap_or_else(PoisonError::into_inner).push(policy);
        Ok(flown?)
    }

    fn policy(&self) -> Result<Policy> {
        let spare = self.policies.lock().unwrap_or_else(PoisonError::into_inner).pop();
        spare.map_or_else(|| Ok(Policy::load(&self.model, self.library.as_deref(), 1)?), Ok)
    }

    /// That schedules with a chase can be flown: the policy is there.
    ///
    /// # Errors
    /// It is not, or it is no chase's.
    pub fn check(&self) -> Result<()> {
        let policy = self.policy()?;
        if policy.contract().model().task != CoreTask::Track {
            bail!("{} was not trained to track: name a vehicle file whose policy is", self.model.display());
        }
        self.policies.lock().map_err(|_| eyre!("a thread failed"))?.push(policy);
        Ok(())
    }
}

fn set(file: &mut toml::Table, section: &str, key: &str, value: toml::Value) {
    if let Some(section) = file.get_mut(section).and_then(toml::Value::as_table_mut) {
        section.insert(key.to_owned(), value);
    }
}
