//! The command `rugosa`; everything is in the library `rugosa_host`.

fn main() -> std::process::ExitCode {
    rugosa_host::cli::main()
}
