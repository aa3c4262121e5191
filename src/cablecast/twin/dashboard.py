"""Dashboard server of the twin: one line in, one line out.

Source: Universal Robots, "Dashboard Server e-Series, port 29999" and "... CB-Series".
"""

from cablecast.twin.controller import (
    MODE_RUNNING,
    SAFETY_EMERGENCY,
    SAFETY_NORMAL,
    SAFETY_PROTECTIVE,
    Controller,
)

GREETING = "Connected: Universal Robots Dashboard Server"
_SAFETY_WORDS = {
    SAFETY_NORMAL: "NORMAL",
    SAFETY_PROTECTIVE: "PROTECTIVE_STOP",
    SAFETY_EMERGENCY: "ROBOT_EMERGENCY_STOP",
}


def answer(controller: Controller, line: str) -> str:
    """Return the answer to one command.

    Args:
        controller: Controller that is asked.
        line: Command, without its line break.
    """
    command = line.strip().lower()
    if command not in _QUIET:
        controller.log("dashboard", command=command)
    if command == "stop":
        controller.stop_program("dashboard")
        return "Stopped"
    if command == "unlock protective stop":
        if controller.safety_mode == SAFETY_PROTECTIVE:
            controller.clear()
        return "Protective stop releasing"
    if command == "is in remote control":
        if not controller.is_e_series:
            return f"could not understand: {line.strip()}"
        return str(controller.remote_control).lower()
    return _facts(controller).get(command, f"could not understand: {line.strip()}")


def _facts(controller: Controller) -> dict[str, str]:
    major, minor, bugfix, build = controller.version
    running = controller.is_running_program
    mode = "RUNNING" if controller.robot_mode == MODE_RUNNING else "POWER_OFF"
    state = f"{'PLAYING' if running else 'STOPPED'} {controller.program_name or '<unnamed>'}"
    safety = _SAFETY_WORDS[controller.safety_mode]
    model = controller.setup.arm.model.removesuffix("e").upper()
    return {
        "robotmode": f"Robotmode: {mode}",
        "safetymode": f"Safetymode: {safety}",
        "safetystatus": f"Safetystatus: {safety}",
        "running": f"Program running: {str(running).lower()}",
        "programstate": state,
        "polyscopeversion": f"URSoftware {major}.{minor}.{bugfix}.{build} (Jan 01 2022)",
        "get robot model": model,
        "get serial number": "20260000000",
        "close popup": "closing popup",
        "close safety popup": "closing safety popup",
        "quit": "Disconnected",
    }


_QUIET = {
    "robotmode",
    "safetymode",
    "safetystatus",
    "running",
    "programstate",
    "polyscopeversion",
    "get robot model",
    "get serial number",
    "is in remote control",
    "quit",
}
