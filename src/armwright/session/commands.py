"""Commands of the session: one table for parsing, prompts, help, completion, tests and docs."""

from __future__ import annotations

from armwright.session import (
    arms,
    controllers,
    dynamics,
    files,
    help,
    printing,
    python_prompt,
    simulation,
    variables,
    watch,
)
from armwright.session.arguments import YES_NO, Argument, same
from armwright.session.listing import TextLine
from armwright.session.workspace import SessionCommand

FRAME = Argument("frame", "frame", "name of a frame of the arm; by default its tip", default="")
PICTURES = ".png, .svg, .pdf or .html"

TABLE = (
    SessionCommand(
        "inverse-arm",
        "Inverse Arm: theta, omega, alpha → torque and voltage; of many sets where a table is named",
        dynamics.inverse_arm,
        (Argument("file", "file", "CSV with columns q_JOINT, qd_JOINT, qdd_JOINT, one set a row", default=""),),
        "τ = M(θ) θ̈ + C(θ, θ̇) θ̇ + g(θ) + friction;  V = R τ / (n Kt) + n Ke θ̇",
        "CMU report, eqs (1)-(11); recursive Newton-Euler [LuhWalkerPaul1980]",
        "inverse-arm", True,
    ),
    SessionCommand(
        "forward-arm",
        "Forward Arm: theta, omega, voltage → alpha; nothing is integrated",
        dynamics.forward_arm, (),
        "M(θ) θ̈ = τ − C(θ, θ̇) θ̇ − g(θ) − friction;  τ = n Kt (V − n Ke θ̇) / R",
        "CMU report, eqs (12)-(26); composite rigid bodies [WalkerOrin1982]",
        "forward-arm", True,
    ),
    SessionCommand(
        "simulate",
        "move the arm: from theta and omega, or on from where the last simulation ended",
        simulation.simulate,
        (
            Argument("start", "choice", "a new simulation, or on with the last one", ("new", "continue"),
                     "Start a new simulation, or continue the last one?"),
            Argument("zero", "choice", "theta and omega set to zero first", YES_NO, "Zero theta and omega first?", "no",
                     lambda values: values["start"] == "new"),
            Argument("schedule", "file", "CSV: t and one column a joint, put out by DACOut; none: constant",
                     prompt="Name of the voltage schedule file", enter="the voltage stays as it is", default="", exists=True),
            Argument("steps", "count", "number of time steps; with a schedule by default until its last row",
                     prompt="For how many time steps?", enter="until the schedule's last row", default="",
                     needed=lambda values: values["schedule"] is None),
            Argument("every", "count", "rows are kept every so many steps; by default every one, with a controller every sample",
                     default=""),
        ),
        "θ̈ = F(θ, θ̇, V), integrated by Kutta's third-order rule with a step of TimeStep",
        "CMU report, Integration; [Kutta1901]",
        "simulate new zero=yes steps=1000", True, check=simulation.check_continue,
    ),
    SessionCommand(
        "plot-simulation", "draw the simulation into a file, or on the screen", printing.plot_simulation,
        (
            Argument("file", "file", f"picture to write, {PICTURES}, which is a page to zoom into; without it on the screen",
                     prompt=f"Name of the picture, {PICTURES}", enter="on the screen", default=""),
            Argument("what", "text", f"of {', '.join(printing.QUANTITIES)}; by default what the motion and the drives show",
                     default=""),
            Argument("joints", "text", "by number or name; by default all", default=""),
        ),
        example="plot-simulation run.png what=theta,voltage joints=2,3", report=True,
        check=simulation.needs_run("plot-simulation"),
    ),
    SessionCommand(
        "print-simulation", "print the simulation on the screen, or into the open output file", printing.print_simulation,
        (
            Argument("start", "time", "first time [s]", prompt="Start [s]", enter="the first row", default=""),
            Argument("finish", "time", "last time [s]", prompt="Finish [s]", enter="the last row", default=""),
            Argument("step", "time", "time from row to row [s]; by default about 25 rows on the screen, all in a file",
                     prompt="Step [s]", enter="about 25 rows on the screen, all in a file", default=""),
            Argument("what", "text", f"of {', '.join(printing.QUANTITIES)}; by default {', '.join(printing.USUAL)}", default=""),
        ),
        example="print-simulation 0 1 0.1 what=theta,voltage", report=True,
        check=simulation.needs_run("print-simulation"),
    ),
    SessionCommand(
        "write-graphic-file", "write the simulation for a display that shows the arm move", simulation.write_graphic_file,
        (Argument("file", "file", "file to write, .glb or .html", prompt="Name of the graphic file (.glb or .html)"),),
        example="write-graphic-file run.html", report=True, check=simulation.needs_run("write-graphic-file"),
    ),
    SessionCommand(
        "save-simulation", "save the simulation with everything in it: .nc, .csv, .parquet, .mcap or .mat", simulation.save_run,
        (Argument("file", "file", "file to write", prompt="Name of the file (.nc, .csv, .parquet, .mcap or .mat)"),),
        example="save-simulation run.nc", check=simulation.needs_run("save-simulation"),
    ),
    SessionCommand(
        "open-output-file", "send what is printed to a file: aligned text, or CSV where its name ends in .csv",
        printing.open_output_file,
        (Argument("file", "file", "file to write; replaced where it exists", prompt="Name of the output file"),),
        example="open-output-file run.csv", report=True,
    ),
    SessionCommand("close-output-file", "send what is printed to the screen again", printing.close_output_file, report=True,
            example="close-output-file"),
    SessionCommand(
        "database-read", "load another arm; its vectors begin at zero", arms.database_read,
        (Argument("robot", "robot", "built-in name, or path of a robot's file", prompt="Name of the arm, or its file"),),
        example="database-read two-link", report=True,
    ),
    SessionCommand(
        "controller", "what DACOut's reference input is wired to; sampled every DACSampTimePeriod", controllers.controller,
        (
            Argument("kind", "text", "a controller, or none; without it the present one is shown", default=""),
            Argument("scale", "text", "position that one volt of DACOut asks for, such as \"10 deg\"", default=""),
        ),
        "u = controller(θ_ref, θ, θ̇) every DACSampTimePeriod, θ_ref = scale · DACOut",
        "armwright.control; design of sampled loops [AstromHagglund2006]",
        "controller joint-pid kp=900 kd=60 scale=\"10 deg\"", pairs=True,
    ),
    SessionCommand(
        "payload", "put something into the hand, or take it out; alone: what it holds", arms.payload,
        (
            Argument("mass", "text", "mass [kg], or none; without it what there is", default=""),
            Argument("com", "text", "centre of mass [m] in the frame's axes; by default its origin", default="",
                     wanted=lambda values: values["mass"] != arms.NONE),
            Argument("inertia", "text", "principal moments about it [kg m²]; by default none", default="",
                     wanted=lambda values: values["mass"] != arms.NONE),
            Argument("frame", "frame", "frame that carries it; by default the tip", default="",
                     wanted=lambda values: values["mass"] != arms.NONE),
        ),
        "one more rigid body, added by parallel axes", "[Symon1971]", "payload 2 com=\"0 0 0.05\"",
    ),
    SessionCommand("energy", "kinetic and potential energy, and their sum", dynamics.energy, (),
            "T = ½ θ̇ᵀ M(θ) θ̇,  U = − Σ m gᵀ c", "[Featherstone2008]", "energy"),
    SessionCommand("pose", "where the hand is: position and orientation in the base", dynamics.pose, (FRAME,),
            "T = A₁ A₂ … A_N", "[DenavitHartenberg1955]", "pose"),
    SessionCommand("jacobian", "velocities of the hand for a unit of each joint's velocity", dynamics.jacobian, (FRAME,),
            "[v; ω] = J(θ) θ̇", "[Whitney1972]", "jacobian"),
    SessionCommand(
        "watch", "show the arm in a page of this machine's browser, which follows theta and plays each simulation",
        watch.watch,
        (
            Argument("state", "choice", "on, or off", ("on", "off"), default="on"),
            Argument("open", "choice", "open it in the browser too", YES_NO, default="no",
                     wanted=lambda values: values["state"] == "on"),
        ),
        recorded=False, example="watch on",
    ),
    SessionCommand("show", "all variables, or one", variables.show,
            (Argument("name", "text", "a variable; by default all", default=""),), recorded=False, example="show"),
    SessionCommand("undo", "take the last changes back; files stay as they are",
            lambda session, arguments: session.undo(arguments["steps"] or 1),
            (Argument("steps", "count", "how many", default=""),), recorded=False, example="undo"),
    SessionCommand("history", "all that was done, as a script",
            lambda session, arguments: [TextLine(line) for line in session.state.lines], recorded=False, example="history"),
    SessionCommand(
        "save", "save the whole state: variables, arm, payload, controller and simulation", files.save,
        (Argument("file", "file", "file to write, .nc", prompt="Name of the file (.nc)"),), example="save here.nc",
    ),
    SessionCommand(
        "restore", "go back to a state that was saved", files.restore,
        (Argument("file", "file", "file that save wrote", prompt="Name of the file (.nc)"),), recorded=False,
        example="restore here.nc",
    ),
    SessionCommand(
        "run-script", "do the lines of a file, up to the first that fails", files.run_script,
        (Argument("file", "file", "the script", prompt="Name of the script"),), recorded=False, example="run-script my.sim",
    ),
    SessionCommand(
        "record", "keep all that is done, from the beginning, as a script that replays to the same numbers", files.record,
        (Argument("file", "file", "script to write, or off", prompt="Name of the script to write, or off"),), recorded=False,
        example="record my.sim",
    ),
    SessionCommand(
        "python", "a Python prompt with the same names, or one line of it", python_prompt.python,
        (Argument("code", "rest", "a statement; without it a prompt", default=""),), recorded=False,
        example="python theta = np.linspace(0, 1, arm.n)",
    ),
    SessionCommand(
        "help", "all commands and variables, or everything about one", help.help_page,
        (Argument("topic", "text", "a command or variable", default=""),), recorded=False, example="help simulate",
    ),
    SessionCommand("tour", "a first lesson in robot dynamics, in a session of its own", help.tour, recorded=False,
                   example="tour"),
    SessionCommand("quit", "leave", lambda session, arguments: session.quit(), recorded=False, example="quit"),
)  # fmt: skip

COMMANDS = {same(command.name): command for command in TABLE}
COMMANDS |= {"exit": COMMANDS["quit"]}
