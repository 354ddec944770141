//! Where words go: results to standard output, everything about the way there to standard error.

use std::io::{self, Write as _};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Prints as much as was asked for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Output {
    quiet: bool,
}

impl Output {
    pub(crate) fn new(quiet: bool) -> Self {
        Self { quiet }
    }

    /// A remark on the way.
    pub(crate) fn note(self, text: &str) {
        if !self.quiet {
            complain(text);
        }
    }

    /// A bar for `total` steps of the named kind, drawn only on a terminal.
    pub(crate) fn progress(self, total: u64, kind: &'static str) -> ProgressBar {
        let target = if self.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let template = format!("{{bar:30}} {{human_pos}}/{{human_len}} {kind}, {{eta}} left {{msg}}");
        let style = ProgressStyle::with_template(&template).expect("the template is well formed");
        ProgressBar::with_draw_target(Some(total), target).with_style(style)
    }
}

/// A line of the result on standard output, printed even if quiet.
pub(crate) fn answer(text: &str) -> io::Result<()> {
    writeln!(io::stdout().lock(), "{text}")
}

/// A line on standard error; if that is closed, nobody is there to be told.
pub(crate) fn complain(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

#[cfg(test)]
mod tests {
    use super::Output;

    #[test]
    fn a_quiet_bar_is_hidden_and_counts() {
        let bar = Output::new(true).progress(10, "decisions");
        bar.set_position(4);
        assert!(bar.is_hidden());
        assert_eq!((bar.position(), bar.length()), (4, Some(10)));
    }
}
