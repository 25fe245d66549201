#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| fabrica_fuzz::parse_template(data));
