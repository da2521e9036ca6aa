//! Croissant metadata: JSON-LD by the Croissant 1.0 vocabulary, so that programs know files and columns.

use serde_json::{Map, Value, json};

use crate::config::Config;
use crate::licences;
use crate::parquet::Column;

/// A file of the release that is described.
pub struct Described<'a> {
    /// Path in the release.
    pub path: &'a str,
    /// Media type.
    pub kind: &'a str,
    /// SHA-256.
    pub sha256: &'a str,
    /// Bytes.
    pub bytes: usize,
}

/// The context that the specification prints for 1.0.
fn context() -> Value {
    json!({
        "@language": "en", "@vocab": "https://schema.org/",
        "citeAs": "cr:citeAs", "column": "cr:column", "conformsTo": "dct:conformsTo",
        "cr": "http://mlcommons.org/croissant/", "rai": "http://mlcommons.org/croissant/RAI/",
        "data": { "@id": "cr:data", "@type": "@json" },
        "dataType": { "@id": "cr:dataType", "@type": "@vocab" },
        "dct": "http://purl.org/dc/terms/",
        "examples": { "@id": "cr:examples", "@type": "@json" },
        "extract": "cr:extract", "field": "cr:field", "fileProperty": "cr:fileProperty",
        "fileObject": "cr:fileObject", "fileSet": "cr:fileSet", "format": "cr:format", "includes": "cr:includes",
        "isLiveDataset": "cr:isLiveDataset", "jsonPath": "cr:jsonPath", "key": "cr:key", "md5": "cr:md5",
        "parentField": "cr:parentField", "path": "cr:path", "recordSet": "cr:recordSet", "references": "cr:references",
        "regex": "cr:regex", "repeated": "cr:repeated", "replace": "cr:replace", "sc": "https://schema.org/",
        "separator": "cr:separator", "source": "cr:source", "subField": "cr:subField", "transform": "cr:transform",
    })
}

/// `croissant.json`: index files, the files of scenes and the shards; both indices as record sets.
pub fn metadata(
    config: &Config,
    index: &Described<'_>,
    objects: &Described<'_>,
    index_columns: &[(&str, Column)],
    object_columns: &[(&str, Column)],
) -> Value {
    let url = |path: &str| {
        if config.url.is_empty() { path.to_owned() } else { format!("{}/{path}", config.url.trim_end_matches('/')) }
    };
    let file = |d: &Described<'_>| {
        json!({
            "@type": "cr:FileObject", "@id": d.path, "name": d.path, "contentUrl": url(d.path),
            "contentSize": format!("{} B", d.bytes), "encodingFormat": d.kind, "sha256": d.sha256,
        })
    };
    let licence = licences::find(&config.licence).map_or_else(|| config.licence.clone(), |l| l.url.to_owned());
    let mut value = Map::new();
    let mut put = |key: &str, v: Value| {
        value.insert(key.to_owned(), v);
    };
    put("@context", context());
    put("@type", json!("sc:Dataset"));
    put("name", json!(config.name));
    put("description", json!(config.description));
    put("conformsTo", json!("http://mlcommons.org/croissant/1.0"));
    put("license", json!(licence));
    put("url", json!(if config.url.is_empty() { "https://example.org/" } else { config.url.as_str() }));
    put("version", json!(config.version));
    if !config.date_published.is_empty() {
        put("datePublished", json!(config.date_published));
    }
    if !config.cite_as.is_empty() {
        put("citeAs", json!(config.cite_as));
    }
    if !config.creators.is_empty() {
        let people: Vec<Value> = config.creators.iter().map(|c| json!({ "@type": "sc:Person", "name": c })).collect();
        put("creator", json!(people));
    }
    put("keywords", json!(["indoor scene", "single-image reconstruction", "3D", "simulation"]));
    put("distribution", json!([file(index), file(objects)]));
    let sets = [(index, "scenes", index_columns), (objects, "objects", object_columns)];
    let sets: Vec<Value> = sets.iter().map(|(d, name, columns)| record_set(d, name, columns)).collect();
    put("recordSet", json!(sets));
    Value::Object(value)
}

fn record_set(file: &Described<'_>, name: &str, columns: &[(&str, Column)]) -> Value {
    let fields: Vec<Value> = columns
        .iter()
        .map(|(column, data)| {
            let kind = match data {
                Column::Text(_) => "sc:Text",
                Column::Int(_) => "sc:Integer",
                Column::Real(_) => "sc:Float",
                Column::Bool(_) => "sc:Boolean",
            };
            json!({
                "@type": "cr:Field", "@id": format!("{name}/{column}"), "name": format!("{name}/{column}"),
                "dataType": kind,
                "source": { "fileObject": { "@id": file.path }, "extract": { "column": column } },
            })
        })
        .collect();
    let key = if name == "scenes" {
        json!({ "@id": "scenes/scene" })
    } else {
        json!([{ "@id": "objects/scene" }, { "@id": "objects/id" }])
    };
    json!({ "@type": "cr:RecordSet", "@id": name, "name": name, "key": key, "field": fields })
}
