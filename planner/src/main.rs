//! The `planner` program: arguments in, library calls, text out.

mod cli;
mod console;

use std::io::IsTerminal;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context;
use clap::{CommandFactory, Parser};
use cli::{BenchArguments, Cli, Command, PlanArguments, PlannerArguments, ServeArguments};
use planner::answer::Answer;
use planner::bench::bench;
use planner::cloud_file::write_ply;
use planner::input::{
    InputError, OrientationInput, PoseInput, PosePartsInput, Request, RequestInput, SourceInput, assemble, from_file,
    parse_file,
};
use planner::picture::{PictureError, draw};
use planner::serve::{ServeError, ServeOptions, serve};
use planner::{Config, Observation, PlanError, Planner, PlannerError, demo};
use program::Exit;
use program::manual::{Manual, Settings};
use schema::Grid;

fn main() -> ExitCode {
    let command = Cli::parse().command;
    let level = tracing_subscriber::filter::LevelFilter::WARN.into();
    let filter = tracing_subscriber::EnvFilter::builder().with_default_directive(level).with_env_var("GRASPMILL_LOG");
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_env_filter(filter.from_env_lossy())
        .init();
    if let Err(error) = program::writes_fail_at_the_file_size_limit() {
        tracing::warn!(%error, "a write beyond the file-size limit will end this program");
    }
    let ended = match command {
        Command::Plan(arguments) => run_plan(&arguments),
        Command::Serve(arguments) => run_serve(&arguments),
        Command::Bench(arguments) => run_bench(&arguments),
        Command::Manual(manual) => run_manual(&manual),
    };
    match ended {
        Ok(()) => program::ExitCode::Ok.into(),
        Err(error) => {
            console::complain(&format!("error: {}", program::text::error_chain(error.as_ref())));
            exit_code_of(&error).into()
        }
    }
}

/// The one place where errors become exit codes.
fn exit_code_of(error: &anyhow::Error) -> program::ExitCode {
    let codes = [
        error.downcast_ref().map(InputError::exit_code),
        error.downcast_ref().map(PlanError::exit_code),
        error.downcast_ref().map(PlannerError::exit_code),
        error.downcast_ref().map(ServeError::exit_code),
        error.downcast_ref::<PictureError>().map(|_| program::ExitCode::Internal),
        error.downcast_ref::<std::io::Error>().map(|_| program::ExitCode::TryAgain),
    ];
    codes.into_iter().flatten().next().unwrap_or(program::ExitCode::Internal)
}

fn made_planner(arguments: &PlannerArguments) -> anyhow::Result<Planner> {
    if let Some(threads) = arguments.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into());
        pool.build_global().context("failed to start the threads")?;
    }
    let config = Config::load(arguments.config.as_deref()).map_err(PlannerError::from)?;
    Ok(match &arguments.model {
        Some(model) => Planner::new(model, config)?,
        None => Planner::built_in(config)?,
    })
}

fn run_plan(arguments: &PlanArguments) -> anyhow::Result<()> {
    let planner = made_planner(&arguments.planner)?;
    let Request { observation, wishes, warnings } = request(arguments, *planner.grid())?;
    let mut plan = planner.plan(&observation, &wishes)?;
    plan.warnings.extend(warnings);
    if let Some(path) = &arguments.picture {
        write(path, &draw(&plan, planner.gripper(), &title(arguments))?)?;
    }
    if let Some(path) = &arguments.ply {
        write(path, &write_ply(&plan))?;
    }
    let answer = Answer::new(&plan, &planner, planner.policy(&wishes));
    let json = serde_json::to_string_pretty(&answer)? + "\n";
    match &arguments.out {
        Some(path) => write(path, json.as_bytes())?,
        None => console::print(&json)?,
    }
    if !arguments.quiet {
        console::complain(console::summary(&plan).trim_end());
    }
    Ok(())
}

fn run_manual(manual: &Manual) -> anyhow::Result<()> {
    let settings = [
        Settings { path: "configs/plan/paper.toml", toml: include_str!("../../configs/plan/paper.toml") },
        Settings { path: "configs/plan/refined.toml", toml: include_str!("../../configs/plan/refined.toml") },
    ];
    manual.make(Cli::command(), &settings, "").context("failed to write the manual")
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    program::publish(path, bytes).with_context(|| format!("failed to write {}", path.display()))
}

/// What is to be planned: a file's request or one made of flags, which count more than the file.
fn request(arguments: &PlanArguments, grid: Grid) -> anyhow::Result<Request> {
    let mut input = match &arguments.views {
        Some(path) => parse_file(path)?,
        None if arguments.demo => demo::request()?,
        None => RequestInput::default(),
    };
    add_flags(arguments, &mut input);
    let folder = arguments.views.as_deref().and_then(Path::parent).unwrap_or(Path::new(""));
    let request = assemble(&input, Some(folder), grid);
    Ok(match &arguments.views {
        Some(path) => request.map_err(|error| error.at(&path.display().to_string())),
        None => request,
    }?)
}

fn add_flags(arguments: &PlanArguments, input: &mut RequestInput) {
    let source = |path: &PathBuf| SourceInput::Path(path.to_string_lossy().into_owned());
    input.tsdf = arguments.tsdf.as_ref().map(source).or(input.tsdf.take());
    input.cloud = arguments.cloud.as_ref().map(source).or(input.cloud.take());
    if !arguments.eye.is_empty() {
        input.eyes_m = Some(arguments.eye.clone());
    }
    if let Some(policy) = arguments.policy {
        input.policy = Some(policy.name().to_owned());
    }
    input.grasps_max = arguments.grasps.map(|count| count as usize).or(input.grasps_max);
    input.check_collisions = arguments.check_collisions.then_some(true).or(input.check_collisions);
    input.explain = arguments.explain.then_some(true).or(input.explain);
    if let Some([x, y, z, quaternion_xyzw @ ..]) = arguments.base_from_workspace {
        let position_m = [x, y, z];
        input.base_from_workspace = Some(PoseInput::Parts(PosePartsInput { position_m, quaternion_xyzw }));
    }
    if let Some(quaternion_xyzw) = arguments.wrist {
        input.workspace_from_wrist = Some(OrientationInput { quaternion_xyzw });
    }
}

fn title(arguments: &PlanArguments) -> String {
    let file = |path: &Path| path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let paths = [&arguments.views, &arguments.tsdf, &arguments.cloud];
    paths.into_iter().flatten().next().map_or_else(|| "demo".to_owned(), |path| file(path))
}

fn run_serve(arguments: &ServeArguments) -> anyhow::Result<()> {
    let planner = made_planner(&arguments.planner)?;
    let options = ServeOptions {
        address: SocketAddr::new(arguments.host, arguments.port),
        body_bytes_max: usize::from(arguments.body_mib_max) << 20,
        request_timeout: Duration::from_secs(arguments.timeout_s.into()),
        concurrent_max: arguments.concurrent.into(),
        queue_max: arguments.queue.into(),
    };
    let told = || console::complain("stopping when the plans under way are made; again to stop at once");
    let stop = program::stop_on_signals(told).context("failed to listen for signals")?;
    if !arguments.host.is_loopback() {
        console::complain(
            "warning: not a loopback address, and there are no passwords: anyone who reaches it may use it",
        );
    }
    serve(planner, &options, &stop, &|address| {
        // A closed standard output is no reason not to serve.
        let _ = console::print(&format!("listening on http://{address}\n"));
    })?;
    Ok(())
}

fn run_bench(arguments: &BenchArguments) -> anyhow::Result<()> {
    let planner = made_planner(&arguments.planner)?;
    let request = match &arguments.views {
        Some(path) => from_file(path, *planner.grid())?,
        None => assemble(&demo::request()?, None, *planner.grid())?,
    };
    let Observation::Views(views) = &request.observation else {
        return Err(InputError::Value("the bench needs depth images: --views".to_owned()).into());
    };
    let report = bench(&planner, views, arguments.plans as usize)?;
    if arguments.json {
        console::print(&(serde_json::to_string_pretty(&report)? + "\n"))?;
    } else {
        console::print(&console::bench(&report))?;
    }
    Ok(())
}
