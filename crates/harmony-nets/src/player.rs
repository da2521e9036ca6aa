//! What the role players of the image networks share.

use std::sync::{Arc, Mutex, PoisonError};

use harmony_roles::{PlayerCard, RoleError};
use image::RgbImage;

use crate::NetError;

/// The card of a network: it only computes, and each call uses the whole device.
pub(crate) fn card(player: &str, model: &str) -> PlayerCard {
    PlayerCard { player: player.to_owned(), model: model.to_owned(), offline: true, concurrency: 1 }
}

/// Runs a network beside the asynchronous work.
pub(crate) async fn computed<T: Send + 'static>(
    player: &'static str,
    work: impl FnOnce() -> Result<T, NetError> + Send + 'static,
) -> Result<T, RoleError> {
    let unavailable =
        |reason: String| RoleError::Unavailable { player: player.to_owned(), reason, status: None, retry_after: None };
    match tokio::task::spawn_blocking(work).await {
        Ok(Ok(found)) => Ok(found),
        Ok(Err(NetError::Input { reason, .. })) => Err(RoleError::NotCapable { player: player.to_owned(), reason }),
        Ok(Err(error)) => Err(unavailable(error.to_string())),
        Err(error) => Err(unavailable(format!("the network's thread ended: {error}"))),
    }
}

/// One photo and what belongs to it.
pub(crate) struct Last<T>(Mutex<Option<(Arc<RgbImage>, Arc<T>)>>);

impl<T> Default for Last<T> {
    fn default() -> Self {
        Self(Mutex::new(None))
    }
}

impl<T> Last<T> {
    /// What belongs to a photo, computed if the last one was another. Others wait meanwhile.
    pub(crate) fn of(
        &self,
        photo: &Arc<RgbImage>,
        compute: impl FnOnce(&RgbImage) -> Result<T, NetError>,
    ) -> Result<Arc<T>, NetError> {
        let mut last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((before, found)) = last.as_ref()
            && (Arc::ptr_eq(before, photo) || before == photo)
        {
            return Ok(found.clone());
        }
        // The old one goes first: both together may be more than the device holds.
        *last = None;
        let found = Arc::new(compute(photo)?);
        *last = Some((photo.clone(), found.clone()));
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_photo_is_computed_once_until_another_comes() {
        let (last, mut runs) = (Last::default(), 0);
        let (a, b) = (Arc::new(RgbImage::new(2, 2)), Arc::new(RgbImage::new(3, 2)));
        // An equal photo in other memory is the same photo.
        for photo in [&a, &a, &Arc::new((*a).clone()), &b, &a] {
            let width = last.of(photo, |p| {
                runs += 1;
                Ok(p.width())
            });
            assert_eq!(*width.expect("computed"), photo.width());
        }
        assert_eq!(runs, 3);
    }
}
