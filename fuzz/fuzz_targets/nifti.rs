#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| fabrica_fuzz::read("a.nii", data));
