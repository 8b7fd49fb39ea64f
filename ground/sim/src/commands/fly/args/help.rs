//! What `goshawk-sim fly --help` ends with.

use goshawk_core::Task;

use crate::trial::rule;

const EXAMPLES: &str = "Examples:\n  goshawk-sim fly --task track --speed 3,5,7 --trials 100 --seed 1 --spacing 4\n  \
                  goshawk-sim fly --task navigate --speed 8 --trials 20 --seed 1 --json out.json   # then goshawk \
                  campaign report out.json\n  \
                  goshawk-sim fly --task navigate --pilot policy,classical --speed 4,8 --length 120   # both on the same \
                  seeds\n  \
                  goshawk-sim fly --task track --speed 5 --moving 8   # eight posts and boxes cross the way\n  \
                  goshawk-sim fly --task track --speed 5 --evader reactive --length 80\n  \
                  goshawk-sim fly --task track --speed 3,5,7 --course goal,zigzag,u-turn,square,eight,stop-and-go   # how \
                  near it comes to who turns on it\n  \
                  goshawk-sim fly --task track --speed 4 --airframe hover_thrust=0.5 --airframe attitude_lag_s=0.2   # the \
                  vehicle file is wrong\n  \
                  goshawk-sim fly --task track --speed 3,5 --seed 3 --only 1:4 --log logs";

const EXIT: &str = "Exit status:\n  0    the campaign was flown, however its flights ended\n  \
                  1    it could not be flown, or what it found not written\n  2    the command line is wrong\n  \
                  130  interrupted (143: terminated); what is not whole is removed";

/// Examples, the rule, the exit status.
pub(super) fn after_help() -> String {
    let [track, navigate] = [Task::Track, Task::Navigate].map(|task| rule::words(task).replace('\n', "\n    "));
    format!(
        "{EXAMPLES}\n\nWhat a flight must do, as each table says too:\n  track\n    {track}\n  navigate\n    {navigate}\n\nCruise \
         speed is the way over the time between 15 m after the start and 15 m before the goal.\n\n{EXIT}"
    )
}
