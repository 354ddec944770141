//! The caller's limit of time. This crate reads no clock: it asks.

/// Asks the caller before each iteration whether his time is up, until it is.
pub(crate) struct Watch<'a> {
    out_of_time: &'a mut dyn FnMut() -> bool,
    over: bool,
}

impl<'a> Watch<'a> {
    pub(crate) fn new(out_of_time: &'a mut dyn FnMut() -> bool) -> Self {
        Self { out_of_time, over: false }
    }

    pub(crate) fn is_over(&mut self) -> bool {
        self.over = self.over || (self.out_of_time)();
        self.over
    }

    /// Whether the time was up when last asked.
    pub(crate) fn was_over(&self) -> bool {
        self.over
    }
}
