//! `schema.txt` is what the types say. Regenerate it with `BLESS=1 cargo test -p
//! rugosa-wire --test schema`, and then raise `PROTOCOL`.

use rugosa_wire::*;
use serde_reflection::{
    ContainerFormat, Format, FormatHolder, Named, Registry, Samples, Tracer, TracerConfig,
    VariantFormat,
};

fn registry() -> Registry {
    let mut tracer = Tracer::new(TracerConfig::default());
    let samples = Samples::new();
    tracer.trace_type::<Header>(&samples).unwrap();
    tracer.trace_type::<Role>(&samples).unwrap();
    tracer.trace_type::<BeamModel>(&samples).unwrap();
    tracer.trace_type::<TableKind>(&samples).unwrap();
    tracer.trace_type::<Packing>(&samples).unwrap();
    tracer.trace_type::<Verdict>(&samples).unwrap();
    tracer.trace_type::<Message>(&samples).unwrap();
    tracer.registry().unwrap()
}

fn type_name(format: &Format) -> String {
    match format {
        Format::TypeName(name) => name.clone(),
        Format::Seq(of) => format!("[{}]", type_name(of)),
        Format::TupleArray { content, size } => format!("[{}; {size}]", type_name(content)),
        Format::Tuple(of) => {
            let all_alike = of.windows(2).all(|pair| pair[0] == pair[1]);
            assert!(all_alike, "only arrays are tuples here");
            format!("[{}; {}]", type_name(&of[0]), of.len())
        }
        plain => format!("{plain:?}").to_lowercase(),
    }
}

fn fields(fields: &[Named<Format>]) -> String {
    let all: Vec<_> = fields
        .iter()
        .map(|field| format!("{}: {}", field.name, type_name(&field.value)))
        .collect();
    format!("{{ {} }}", all.join(", "))
}

fn variant(number: u32, named: &Named<VariantFormat>) -> String {
    let content = match &named.value {
        VariantFormat::Unit => String::new(),
        VariantFormat::NewType(of) => format!("({})", type_name(of)),
        VariantFormat::Struct(of) => format!(" {}", fields(of)),
        other => panic!("no such variants here: {other:?}"),
    };
    format!("  {number} {}{content}\n", named.name)
}

fn describe(name: &str, container: &ContainerFormat) -> String {
    match container {
        ContainerFormat::Struct(of) => format!("{name} {}\n", fields(of)),
        ContainerFormat::Enum(variants) => variants
            .iter()
            .fold(format!("{name} is one of\n"), |text, (number, named)| {
                text + &variant(*number, named)
            }),
        other => panic!("no such types here: {other:?}"),
    }
}

fn schema() -> String {
    let limits = format!(
        "rugosa wire: postcard, in this order of fields and variants\n\
         at most: {MAX_RANGE_BYTES} bytes of ranges or reflectances, {MAX_TABLE} table values, \
         {MAX_PATCH} patch values, {COUNTERS} counters, {MAX_ECHO} echo bytes, \
         32 bytes of device, 16 bytes of version\n"
    );
    registry()
        .iter()
        .fold(limits, |mut text, (name, container)| {
            let mut container = container.clone();
            container.normalize().unwrap();
            text += &describe(name, &container);
            text
        })
}

#[test]
fn the_schema_file_is_what_the_types_say() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/schema.txt");
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(path, schema()).unwrap();
    }
    assert_eq!(std::fs::read_to_string(path).unwrap(), schema());
    assert_eq!(schema_hash(), bitwise_crc32(SCHEMA.as_bytes()));
}

/// The bitwise definition of CRC-32/ISO-HDLC.
fn bitwise_crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| {
            (c >> 1) ^ (0xEDB8_8320 * (c & 1))
        })
    })
}
