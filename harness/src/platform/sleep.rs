use std::io;
use std::time::Duration;

/// A timer of the runtime's.
#[derive(Debug)]
pub(crate) struct Timer;

impl Timer {
    /// One that can be waited for.
    ///
    /// # Errors
    /// None here.
    pub(crate) fn new() -> io::Result<Self> {
        Ok(Self)
    }

    /// Waits for so long. Cancel-safe.
    ///
    /// # Errors
    /// None here.
    pub(crate) async fn wait(&self, wall: Duration) -> io::Result<()> {
        tokio::time::sleep(wall).await;
        Ok(())
    }
}
