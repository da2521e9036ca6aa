//! Two objects may show the same picture (one thing that was found at two levels): a player that sees the picture alone
//! is asked, and paid, once.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use crate::common::{Desk, Everyone, Scripted, card, cast, small_mesh, tree};
use async_trait::async_trait;
use harmony_calls::{Bill, BookOptions, CallName, CallRecord, Cast, Source};
use harmony_mesh::TemplateParams;
use harmony_roles::{
    GeneratedMesh, MeshFrame, MeshGenerator, MeshRequest, MeshSettings, PlayerCard, Role, RoleError, Usage,
};
use harmony_scene::{Level, Size};
use image::{Rgba, RgbaImage};

/// Makes meshes slowly; the first `broken` of them have no triangle.
struct Sculptor {
    picture_only: bool,
    broken: usize,
    asked: AtomicUsize,
}

impl Sculptor {
    fn new(picture_only: bool, broken: usize) -> Arc<Self> {
        Arc::new(Self { picture_only, broken, asked: AtomicUsize::new(0) })
    }

    fn asked(&self) -> usize {
        self.asked.load(Ordering::Relaxed)
    }
}

#[async_trait]
impl MeshGenerator for Sculptor {
    fn card(&self) -> PlayerCard {
        card("sculptor", false)
    }

    fn sees_picture_only(&self) -> bool {
        self.picture_only
    }

    async fn generate(&self, _request: &MeshRequest) -> Result<GeneratedMesh, RoleError> {
        let before = self.asked.fetch_add(1, Ordering::Relaxed);
        tokio::time::sleep(Duration::from_mins(1)).await;
        let mut mesh = small_mesh(0.0);
        if before < self.broken {
            mesh.groups.clear();
        }
        Ok(GeneratedMesh {
            mesh: Arc::new(mesh),
            convex: None,
            frame: MeshFrame::Raw,
            part_model: None,
            source: "sculptor".into(),
            notes: vec![],
            usage: Usage { cost_usd: Some(0.25), ..Usage::default() },
        })
    }
}

fn desk(run: &Path, sculptor: &Arc<Sculptor>) -> Desk {
    let vlm = Scripted::saying("offline", true, &[]);
    let offline = cast(&vlm, &Everyone::new("offline", true, false));
    Desk::with(run, BookOptions::default(), Cast { mesh_generator: sculptor.clone(), ..offline.clone() }, offline)
}

/// A mesh of one grey; label and size as of different things.
fn request(name: &str, label: &str, grey: u8) -> MeshRequest {
    MeshRequest {
        name: name.into(),
        crop: Arc::new(RgbaImage::from_pixel(6, 6, Rgba([grey, grey, grey, 255]))),
        label: label.into(),
        description: format!("a {label}"),
        level: if label == "picture" { Level::Wall } else { Level::Furniture },
        size: Size { width: label.len() as f64 / 10.0, height: 0.9, depth: 0.5 },
        template: None,
        params: TemplateParams::default(),
        part_model: None,
        settings: MeshSettings::default(),
    }
}

fn record(desk: &Desk, name: &str) -> CallRecord {
    desk.calls.book().record(Role::MeshGenerator, &CallName::new(name).unwrap()).unwrap()
}

const WALL: &str = "2_wall/picture_02/mesh";
const FLOOR: &str = "3_furniture/furniture_02/mesh";

#[tokio::test(start_paused = true)]
async fn one_picture_under_two_names_is_paid_once_also_side_by_side_and_after_a_restart() {
    let run = tempfile::tempdir().unwrap();
    let sculptor = Sculptor::new(true, 0);
    let first = desk(run.path(), &sculptor);
    let (wall, floor) = (request(WALL, "picture", 9), request(FLOOR, "furniture", 9));
    let (a, b) = tokio::join!(first.calls.generate_mesh(&wall), first.calls.generate_mesh(&floor));
    assert_eq!(a.unwrap().mesh.positions, b.unwrap().mesh.positions);
    assert_eq!(sculptor.asked(), 1);
    let sources = [record(&first, WALL).source, record(&first, FLOOR).source];
    assert!(sources.contains(&Source::Player), "{sources:?}");
    assert!(sources.iter().any(|source| matches!(source, Source::Shared { with } if [WALL, FLOOR].contains(&&**with))));
    let bill = Bill::of(&first.calls.book().log().unwrap());
    assert_eq!((bill.total.calls, bill.total.tries, bill.total.recorded), (2, 1, 1));
    assert_eq!(bill.total.usage.cost_usd, Some(0.25));

    let second = desk(run.path(), &sculptor);
    second.calls.generate_mesh(&request("5_decoration/box_01/mesh", "box", 9)).await.unwrap();
    assert_eq!(sculptor.asked(), 1, "the record of an earlier start answers");
    let before = tree(run.path());
    second.calls.generate_mesh(&floor).await.unwrap();
    assert_eq!(tree(run.path()), before, "each call has a record of its own");
    second.calls.generate_mesh(&request("5_decoration/box_02/mesh", "box", 10)).await.unwrap();
    assert_eq!(sculptor.asked(), 2, "another picture is other work");
}

#[tokio::test(start_paused = true)]
async fn a_player_that_reads_words_is_asked_for_each_object() {
    let run = tempfile::tempdir().unwrap();
    let sculptor = Sculptor::new(false, 0);
    let desk = desk(run.path(), &sculptor);
    desk.calls.generate_mesh(&request(WALL, "picture", 9)).await.unwrap();
    desk.calls.generate_mesh(&request(FLOOR, "furniture", 9)).await.unwrap();
    assert_eq!(sculptor.asked(), 2);
    assert_eq!(record(&desk, FLOOR).source, Source::Player);
}

#[tokio::test(start_paused = true)]
async fn an_answer_that_was_not_taken_is_not_shared() {
    let run = tempfile::tempdir().unwrap();
    // Three unusable meshes, so that somebody stands in for the first object; the fourth is good.
    let sculptor = Sculptor::new(true, 3);
    let desk = desk(run.path(), &sculptor);
    desk.calls.generate_mesh(&request(WALL, "picture", 9)).await.unwrap();
    assert!(matches!(record(&desk, WALL).source, Source::Replaced { .. }));
    desk.calls.generate_mesh(&request(FLOOR, "furniture", 9)).await.unwrap();
    assert_eq!((sculptor.asked(), record(&desk, FLOOR).source), (4, Source::Player));
}
