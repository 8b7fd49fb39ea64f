//! What tasks, pilots, evaders, outcomes and contacts are called in reports.

use goshawk_core::Task;

use crate::trial::{Contact, EvaderKind, Outcome, PilotKind};

/// The task's name in the report.
#[must_use]
pub fn task_name(task: Task) -> &'static str {
    match task {
        Task::Track => "track",
        Task::Navigate => "navigate",
    }
}

/// The pilot's name in the report.
#[must_use]
pub fn pilot_name(pilot: PilotKind) -> &'static str {
    match pilot {
        PilotKind::Policy => "policy",
        PilotKind::Classical => "classical",
    }
}

/// The evader's name in the report.
#[must_use]
pub fn evader_name(evader: EvaderKind) -> &'static str {
    match evader {
        EvaderKind::Planned => "planned",
        EvaderKind::Reactive => "reactive",
    }
}

/// The outcome's name in the report.
#[must_use]
pub fn outcome_name(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Success => "success",
        Outcome::Collision => "collision",
        Outcome::Lost => "lost",
        Outcome::Timeout => "timeout",
        Outcome::TooClose => "too-close",
        Outcome::Behind => "behind",
        Outcome::OutOfView => "out-of-view",
        Outcome::Slow => "slow",
    }
}

/// The contact's name in the report.
#[must_use]
pub fn contact_name(contact: Contact) -> &'static str {
    match contact {
        Contact::Trunk => "trunk",
        Contact::Branch => "branch",
        Contact::Foliage => "foliage",
        Contact::Building => "building",
        Contact::Scan => "scan",
        Contact::Moving => "moving",
        Contact::Ground => "ground",
        Contact::Person => "person",
    }
}
