//! Photo and renders: one over the other, and side by side.

use std::fmt::Write;
use std::path::Path;

use rayon::prelude::*;

use crate::ReportData;
use crate::html::esc;
use crate::pictures::{LARGE, Picture};

/// Pictures found by their names: file, caption, whether the photo's camera took it.
const KNOWN: [(&str, &str, bool); 4] = [
    ("render_lit.png", "Path-traced render", true),
    ("render_flat.png", "Flat render", true),
    ("segmentation.png", "Segmentation", true),
    ("render_canonical.png", "Render from the room's canonical view", false),
];

pub(crate) fn pictures(run: &Path, report: &ReportData) -> String {
    let photo = Picture::photo(run);
    let mut others: Vec<(String, bool, Picture)> = Vec::new();
    let mut missing = Vec::new();
    let read: Vec<Option<Picture>> = KNOWN.par_iter().map(|(file, _, _)| Picture::read(run, file, LARGE)).collect();
    for ((file, title, comparable), picture) in KNOWN.into_iter().zip(read) {
        match picture {
            Some(p) => others.push((title.to_owned(), comparable, p)),
            None => missing.push(file),
        }
    }
    for extra in &report.pictures {
        if let Some(p) = Picture::read(run, &extra.path, LARGE) {
            others.push((extra.title.clone(), extra.comparable, p));
        }
    }
    let mut out = "<h2 id=\"pictures\">Photo and renders</h2>".to_owned();
    if let Some(photo) = &photo
        && let Some((_, _, first)) = others.iter().find(|(_, comparable, _)| *comparable)
    {
        wipe(&mut out, photo, first, &others);
    }
    out.push_str("<div class=\"gallery\">");
    match &photo {
        Some(p) => figure(&mut out, "photo", "Photo", p),
        None => missing.insert(0, "input"),
    }
    for (k, (title, _, p)) in others.iter().enumerate() {
        figure(&mut out, &format!("picture{k}"), title, p);
    }
    out.push_str("</div>");
    if !missing.is_empty() {
        let _ = write!(out, "<p class=\"soft\">Not made in this run: {}.</p>", esc(&missing.join(", ")));
    }
    out
}

fn wipe(out: &mut String, photo: &Picture, first: &Picture, others: &[(String, bool, Picture)]) {
    out.push_str("<div class=\"card\"><div class=\"bar\"><span class=\"soft\">Photo against</span>");
    let mut pressed = true;
    let mut tag = String::new();
    for (k, (title, comparable, _)) in others.iter().enumerate() {
        if *comparable {
            let _ = write!(
                out,
                "<button type=\"button\" data-over=\"picture{k}\" aria-pressed=\"{pressed}\">{}</button>",
                esc(title)
            );
            if pressed {
                tag = esc(title);
            }
            pressed = false;
        }
    }
    let _ = write!(
        out,
        "</div><div class=\"wipe\" id=\"wipe\"><img src=\"{}\" alt=\"Photo\" width=\"{}\" height=\"{}\"><img class=\"over\" \
         src=\"{}\" alt=\"Render\"><span class=\"tag left\">Photo</span><span class=\"tag right\">{tag}</span><input \
         type=\"range\" min=\"0\" max=\"100\" step=\"0.1\" value=\"50\" aria-label=\"Where the photo ends and the render \
         begins\"></div></div>",
        photo.src, photo.width, photo.height, first.src
    );
}

fn figure(out: &mut String, id: &str, title: &str, p: &Picture) {
    let title = esc(title);
    let _ = write!(
        out,
        "<figure><img id=\"{id}\" src=\"{}\" alt=\"{title}\" width=\"{}\" height=\"{}\" style=\"height:auto\"><figcaption>{title}</figcaption></figure>",
        p.src, p.width, p.height
    );
}
