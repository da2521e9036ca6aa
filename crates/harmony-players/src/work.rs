//! Heavy work beside the asynchronous one.

use harmony_roles::RoleError;

/// Runs what computes on a thread of its own. What breaks off there is a failure of this call, not of the run.
pub(crate) async fn computed<T: Send + 'static>(
    player: &str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, RoleError> {
    tokio::task::spawn_blocking(work).await.map_err(|error| RoleError::NotCapable {
        player: player.to_owned(),
        reason: format!("the computation broke off: {error}"),
    })
}
