//! `evac services`: what a stage in another language needs to know of shared memory.

use std::fmt::Write as _;

use evac_ports::catalogue::{LayoutText, ServiceText, layouts, services};
use evac_ports::services::SliceLen;
use serde_json::{Value, json};

/// Prints every service and layout as JSON, each on a line of its own.
pub(crate) fn print() {
    let services = services();
    let services = services.iter().map(|service| (service.name, service_json(service)));
    let layouts = layouts();
    let layouts = layouts.iter().map(|layout| (layout.name, layout_json(layout)));
    let (services, layouts) = (lines(services), lines(layouts));
    println!(
        "{{\n\"middleware\": {},\n\"services\": {{\n{services}\n}},\n\"layouts\": {{\n{layouts}\n}}\n}}",
        json!(evac_ports::MIDDLEWARE)
    );
}

fn lines(entries: impl Iterator<Item = (&'static str, Value)>) -> String {
    entries.enumerate().fold(String::new(), |mut text, (index, (name, value))| {
        // Writing to a string cannot fail.
        let _ = write!(text, "{}  {}: {value}", if index > 0 { ",\n" } else { "" }, json!(name));
        text
    })
}

fn service_json(service: &ServiceText) -> Value {
    let (len, grows) = match service.len {
        None => (None, false),
        Some(SliceLen::Fixed(len)) => (Some(len), false),
        Some(SliceLen::Growing(len)) => (Some(len), true),
    };
    let qos = &service.qos;
    json!({
        "layout": service.layout,
        "header": service.header,
        "item": service.item,
        "slice_len": len,
        "slice_grows": grows,
        "max_publishers": qos.publishers,
        "max_subscribers": qos.subscribers,
        "max_nodes": qos.nodes,
        "buffer": qos.buffer,
        "borrowed": qos.borrowed,
        "history": qos.history,
    })
}

fn layout_json(layout: &LayoutText) -> Value {
    let fields: Vec<_> =
        layout.fields.iter().map(|field| json!([field.name, field.ty, field.offset])).collect();
    json!({ "type": layout.ty, "size": layout.size, "fields": fields })
}
