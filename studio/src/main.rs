//! `fabrica`: see `fabrica --help`.

fn main() -> std::process::ExitCode {
    fabrica_studio::cli::main(std::env::args_os())
}
