//! The command line: arguments in, exit code out. Errors are one sentence on stderr; 0 = ok, 1 = failed, 2 = usage.

/// Prints a line to stderr; where that is closed or full, nobody is there to be told.
macro_rules! say {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), $($text)*);
    }};
}

mod adapters;
mod bench;
mod inspect;
mod measure;
mod open;
mod plot;
mod progress_bar;
mod reading;
mod render;
mod select;
mod setup;
mod styles;
mod survey;
mod template;
mod volumes;

use std::ffi::OsString;
use std::process::ExitCode;

use anyhow::Result;
use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};

/// Illustrative volume rendering: figures from CT, MRI and micro-CT volumes.
#[derive(Parser, Debug)]
#[command(name = "fabrica", version)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Subcommand, Debug)]
enum Command {
    /// Open the window, which `fabrica` alone does too.
    Open(open::Arguments),
    /// Draw the figure of a template into a PNG file.
    Render(render::Arguments),
    /// Write the first look of a bare volume as a template.
    Template(template::Arguments),
    /// Measure what accuracy costs: time and error of a grid of settings.
    Measure(measure::Arguments),
    /// Time the frames of a turning camera.
    Bench(bench::Arguments),
    /// Say what a volume is: format, size, orientation, values, warnings.
    Inspect(inspect::Arguments),
    /// Select parts of a volume by values, shapes, seeds and label maps; write and measure them.
    Select(select::Arguments),
    /// List the graphics adapters that can draw.
    Adapters(adapters::Arguments),
    /// List the lit-sphere styles that templates can name.
    Styles(styles::Arguments),
    /// Print the JSON Schema of templates.
    Schema,
}

/// A fault of the command line rather than of the work.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct UsageError(String);

impl UsageError {
    fn because(message: impl Into<String>) -> anyhow::Error {
        Self(message.into()).into()
    }
}

/// Runs the program with `arguments`, the first of which is its own name.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let matches = match Cli::command().try_get_matches_from(arguments) {
        Ok(matches) => matches,
        Err(e) => {
            // --help and --version come this way too; a closed pipe is no reason to fail.
            let _ = e.print();
            return ExitCode::from(e.exit_code() as u8);
        }
    };
    let outcome = Cli::from_arg_matches(&matches).map_err(|e| UsageError::because(e.to_string())).and_then(|cli| {
        // The positions of repeated options matter (--raw belongs to the --volume before it).
        let matches = matches.subcommand().map_or(&matches, |(_, m)| m);
        match cli.command {
            Some(command) => run(command, matches),
            None => open::run(open::Arguments::default()),
        }
    });
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            say!("fabrica: {error:#}");
            ExitCode::from(if error.is::<UsageError>() { 2 } else { 1 })
        }
    }
}

fn run(command: Command, matches: &clap::ArgMatches) -> Result<()> {
    match command {
        Command::Open(arguments) => open::run(arguments),
        Command::Render(arguments) => render::run(&arguments, matches),
        Command::Template(arguments) => template::run(&arguments),
        Command::Measure(arguments) => measure::run(&arguments, matches),
        Command::Bench(arguments) => bench::run(&arguments, matches),
        Command::Inspect(arguments) => inspect::run(&arguments),
        Command::Select(arguments) => select::run(&arguments, matches),
        Command::Adapters(arguments) => adapters::run(&arguments),
        Command::Styles(arguments) => styles::run(&arguments),
        Command::Schema => {
            let schema = schemars::schema_for!(crate::figure::Template);
            print_line(&serde_json::to_string_pretty(&schema)?)
        }
    }
}

/// Prints to stdout; a reader that went away (`| head`) is not a failure.
fn print_line(text: &str) -> Result<()> {
    use std::io::Write as _;
    match writeln!(std::io::stdout(), "{text}") {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(fabrica_engine::Error::io(std::path::Path::new("standard output"), &e).into())
        }
        _ => Ok(()),
    }
}
