//! A replay's outcome for the terminal.

use super::{Agreement, Altered, Count, Outcome};

/// Prints the table.
pub fn print(outcome: &Outcome) {
    println!("{}, {:.1} s", outcome.log.display(), outcome.seconds);
    println!("recorded by {}, replayed by {}", outcome.recorded_by, outcome.replayed_by);
    println!("{:<10}{:>10}{:>10}{:>12}", "", "compared", "the same", "different");
    let row = |name: &str, count: Count| {
        println!("{name:<10}{:>10}{:>10}{:>12}", count.of, count.same, count.of - count.same);
    };
    row("plans", outcome.plans);
    row("targets", outcome.targets);
    row("controls", outcome.controls);
    if let Some(network) = outcome.network {
        row("network", network);
    }
    for damage in &outcome.damaged {
        println!("the log is damaged, not cut off; left out: {damage}");
    }
    if let Some(first) = &outcome.missing.first() {
        println!("missing from the log: {first}, and {} more", outcome.missing.len() - 1);
    }
    match &outcome.first_difference {
        None => println!("no difference"),
        Some(d) => {
            println!(
                "first difference at {:.3} s: {}: {} was {}, is {}",
                d.at_s, d.what, d.field, d.logged, d.replayed
            );
        }
    }
    let Some(other) = &outcome.other else { return };
    println!("{} would have chosen", other.policy.display());
    print_agreement(&other.agreement);
}

/// Prints what an alteration changes.
pub fn print_altered(altered: &Altered) {
    if let Some(d) = &altered.first_difference {
        println!("this software replays the flight otherwise from {:.3} s on: {}: {}", d.at_s, d.what, d.field);
    }
    println!("{}", altered.words);
    print_agreement(&altered.agreement);
}

fn print_agreement(found: &Agreement) {
    let share = 100.0 * found.same as f64 / found.frames.max(1) as f64;
    println!("  the same in {} of {} frames ({share:.1} %)", found.same, found.frames);
    println!("  otherwise in {}; in {} of them only one of the two chose", found.frames - found.same, found.one_chose);
    if let Some(apart) = found.end_distance_m {
        println!("  ends {:.2} m apart (median), {:.2} m (95th percentile)", apart.p50, apart.p95);
    }
}
