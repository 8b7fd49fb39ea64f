//! What a failed command says.

use std::error::Error;
use std::iter::successors;

/// The error and its causes in one line, each said once: some messages hold their cause already.
#[must_use]
pub fn one_line(error: &(dyn Error + 'static)) -> String {
    let causes = successors(Some(error), |cause| (*cause).source());
    causes.map(ToString::to_string).fold(String::new(), |line, cause| match line.as_str() {
        "" => cause,
        said if said.contains(&cause) => line,
        said => format!("{said}: {cause}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use color_eyre::eyre::WrapErr;

    #[test]
    fn a_cause_that_the_message_holds_is_not_said_again() {
        let cause = || std::io::Error::other("no such disk");
        let plain = Err::<(), _>(cause()).wrap_err("cannot write log").unwrap_err();
        assert_eq!(one_line(plain.as_ref()), "cannot write log: no such disk");
        let held = Err::<(), _>(cause()).wrap_err("cannot write log (no such disk)").unwrap_err();
        assert_eq!(one_line(held.as_ref()), "cannot write log (no such disk)");
    }
}
