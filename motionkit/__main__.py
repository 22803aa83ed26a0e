"""The command line: `python -m motionkit info FILE`, `play FILE`, `stylize IN --style STYLE -o OUT`, `perform WHAT`,
`imagine SENTENCE`, `learn STYLE --prompt SENTENCE -o FILE`, `train WHAT --data NAME`."""

from __future__ import annotations

import argparse
import importlib
import sys
import warnings
import webbrowser
from pathlib import Path

from . import checkpoints, datasets, methods
from .bvh import load, save
from .errors import MotionKitError
from .files import MotionKitWarning, target

# What `train` makes: a function from a `training.TrainOrder` to a checkpoint. A new method is a line here.
_TRAINERS = {
    "content": "judges:make_content",
    "style": "judges:make_style",
    "autoencoder": "judges:make_autoencoder",
    "text": "text.train:make_text",
    "prior": "methods.text_to_motion:make_prior",
    "discriminator": "methods.text_to_motion:make_discriminator",
    "style-code": "methods.style_code_training:make_style_code",
    "style-encoder": "methods.style_code_training:make_style_encoder",
    "style-erd": "methods.style_erd:make_style_erd",
}
_JUDGES = ("content", "style", "autoencoder")
_UNIT_HELP = "metres in one unit of the file (0.01 for centimetres); guessed from the skeleton's size if left out"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "python -m motionkit", description="Human motion style transfer: look, restyle, write."
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    info = commands.add_parser("info", help="what is in a BVH file: joints, frames, size, sides, problems")
    info.add_argument("file", help="a BVH file")
    info.add_argument("--metres-per-unit", type=float, help=_UNIT_HELP)

    play = commands.add_parser("play", help="open BVH files in a 3D player, a web page that needs no network")
    play.add_argument("files", nargs="+", help="one or more BVH files, shown side by side")
    play.add_argument("-o", "--output", help="the page to write, .html (default: FILE.play.html beside the first)")
    play.add_argument("--no-open", action="store_true", help="write the page, do not open a browser")
    play.add_argument("--metres-per-unit", type=float, help=_UNIT_HELP)

    stylize = commands.add_parser("stylize", help="give a motion the style of another one, and write BVH")
    stylize.add_argument("input", help="the motion to restyle, a BVH file")
    stylize.add_argument(
        "--style", required=True, help="a BVH file or a learned style; style-code, style-erd: or a name"
    )
    strong = "0 keeps the input, 1 is the style, 2 a caricature"
    stylize.add_argument("--strength", type=float, default=1.0, help=strong)
    stylize.add_argument("-o", "--output", required=True, help="the BVH file to write")
    known = f"one of: {', '.join(methods.names())} (statistics; of a learned style the one that it was learned by)"
    stylize.add_argument("--method", help=known)
    stylize.add_argument("--metres-per-unit", type=float, help=_UNIT_HELP)
    _add_perform(commands)
    _add_imagine(commands)
    _add_learn(commands)
    _add_train(commands)
    return parser


def _add_perform(commands: argparse._SubParsersAction) -> None:
    perform = commands.add_parser("perform", help="let the performer make a motion in some style, and write BVH")
    perform.add_argument("content", help='what is done, such as walk, bow, or "walk, jump, kick"')
    perform.add_argument("--style", default="neutral", help="such as old, proud, zombie")
    perform.add_argument("--intensity", type=float, default=1.0, help="0 is neutral, 1 the style, 1.5 exaggerated")
    perform.add_argument("--seconds", type=float, default=6.0)
    perform.add_argument("--seed", type=int, default=0, help="another number, another take")
    perform.add_argument("--performer", help="a person's number, or a creature such as dog or crab")
    perform.add_argument("-o", "--output", required=True, help="the BVH file to write")


def _add_imagine(commands: argparse._SubParsersAction) -> None:
    imagine = commands.add_parser("imagine", help="make a motion of a sentence, and write BVH")
    imagine.add_argument("sentence", help='such as "a person walks in depression"')
    imagine.add_argument("--prior", default="actor", help="the dataset whose prior makes it")
    imagine.add_argument("--seconds", type=float, default=4.0)
    imagine.add_argument("--seed", type=int, default=0, help="another number, another motion")
    imagine.add_argument("--scale", type=float, help="of guidance: more follows the sentence closer")
    imagine.add_argument("-o", "--output", required=True, help="the BVH file to write")


def _add_learn(commands: argparse._SubParsersAction) -> None:
    learn = commands.add_parser("learn", help="learn the style of one clip, and write a small file for stylize --style")
    learn.add_argument("style", help="a clip in the style, a BVH file of a second or more")
    learn.add_argument("--prompt", help='what is done and how, such as "an old person walks"; style-code needs none')
    how = "style-code: in seconds, on the performer's skeleton; few-shot: as in paper 1, in a minute or two"
    learn.add_argument("--method", choices=["style-code", "few-shot"], help=f"{how} (style-code where there is one)")
    learn.add_argument("--prior", default="actor", help="the dataset whose prior learns it")
    learn.add_argument("--root", help="the folder or zip of the captures, where the dataset needs one")
    learn.add_argument("--steps", type=int, help="of the search or of fine-tuning; left out, the method's own")
    learn.add_argument("--seed", type=int, default=0)
    learn.add_argument("--metres-per-unit", type=float, help=_UNIT_HELP)
    learn.add_argument("-o", "--output", required=True, help="the .safetensors file to write, for stylize --style")


def _add_train(commands: argparse._SubParsersAction) -> None:
    train = commands.add_parser("train", help="train on a dataset, and write weights with a card")
    train.add_argument("what", choices=["judge", *_TRAINERS], help=f"judge: {', '.join(_JUDGES)} one after another")
    train.add_argument("--data", default="actor", help=f"one of: {', '.join(datasets.names())}")
    train.add_argument("--root", help="the folder or zip of the captures, where the dataset needs one")
    train.add_argument("--config", default="laptop", choices=["tiny", "laptop", "paper"], help="sizes and numbers")
    train.add_argument("--steps", type=int, help="batches; left out, the config's")
    train.add_argument("--seed", type=int, default=0)
    train.add_argument("--lr", type=float, help="the highest learning rate; left out, the config's")
    train.add_argument("--start", help="the name of a checkpoint to go on from, such as actor-prior")
    train.add_argument("--text", default="mini", help="the text encoder of a prior, such as clip:FOLDER")


def _train(args: argparse.Namespace) -> None:
    """The state of a run is kept beside the weights, so one that was broken off goes on; the first process writes."""
    from .training import TrainOrder, main_process_first

    data = datasets.load(args.data, args.root)
    for what in _JUDGES if args.what == "judge" else [args.what]:
        command = f"python -m motionkit train {what} --data {args.data} --config {args.config} --seed {args.seed}"
        for name in ("steps", "lr", "start"):
            command += f" --{name} {getattr(args, name)}" if getattr(args, name) else ""
        command += f" --text {args.text}" if args.text != "mini" else ""
        path = checkpoints.default_path(args.data, what)
        if what == "text":
            path = checkpoints.folder() / "text-mini.safetensors"
        options = {"steps": args.steps, "lr": args.lr, "seed": args.seed, "start": args.start, "text": args.text}
        order = TrainOrder(data, args.config, **options, resume=path.with_suffix(".run"), title=path.stem)
        module, maker = _TRAINERS[what].split(":")
        model = getattr(importlib.import_module(f".{module}", __package__), maker)(order)
        model.card = {"name": path.stem, "command": command, **model.card}
        main_process_first(lambda model=model, path=path: print(model.save(path)))


def _info(args: argparse.Namespace) -> None:
    motion = load(args.file, args.metres_per_unit)
    skeleton = motion.skeleton
    print(motion)
    print(f"unit: {motion.metres_per_unit:g} m, character about {skeleton.height:.2f} m tall")
    if len(motion):
        low, high = motion.positions().flatten(0, 1).amin(0).tolist(), motion.positions().flatten(0, 1).amax(0).tolist()
        ranges = ", ".join(f"{a} {x:.2f} to {y:.2f}" for a, x, y in zip("xyz", low, high, strict=True))
        print(f"space, metres: {ranges}")
    moving = sum(any(c.endswith("position") for c in channels) for channels in skeleton.channels)
    print(f"joints with position channels: {moving}; body root: {skeleton.names[skeleton.pelvis]}")
    print(
        "left and right:",
        "told by the names" if skeleton.mirror_joints else "NOT told by the names (mirror needs mirror_joints=)",
    )
    for joint, name in enumerate(skeleton.names):
        role = next((r for r, j in skeleton.roles.items() if j == joint), "")
        print(f"  {joint:3d} {'  ' * (len(skeleton.ancestors(joint)) - 1)}{name:<20} {skeleton.sides[joint]:<7} {role}")


def _play(args: argparse.Namespace) -> None:
    from .viewer import save_html

    motions = [load(f, args.metres_per_unit) for f in args.files]
    output = _fresh(args.output or Path(args.files[0]).with_suffix(".play.html"), ".html", args.files)
    page = save_html(motions, output)
    print(page)
    if not args.no_open:
        webbrowser.open(Path(page).resolve().as_uri())


def _stylize(args: argparse.Namespace) -> None:
    output = _fresh(args.output, ".bvh", [args.input, args.style])
    content = load(args.input, args.metres_per_unit)
    method, style = _method_and_style(args)
    print(save(method.stylize(content, style, args.strength), output))


def _method_and_style(args: argparse.Namespace) -> tuple:
    """What `stylize` is to use: a learned style belongs to its method, a name to the methods that know names."""
    kind = Path(args.style).suffix
    if kind == ".safetensors":
        card = checkpoints.load(args.style)[1]
        name = {"style": "few-shot", "style-code": "style-code"}.get(card.get("kind"))
        if name is None or not card.get("data"):
            raise MotionKitError(f"{args.style}: holds no learned style, or its card names no dataset")
        if args.method not in (None, name):
            raise MotionKitError(f"{args.style}: this style was learned by --method {name}; found {args.method!r}")
        method = methods.load(name, prior=card["data"])
        return method, method.load_style(args.style)
    method = methods.load(args.method or "statistics")
    if not kind and not Path(args.style).exists():
        if method.name in ("style-code", "style-erd", "linear"):
            return method, args.style
        raise MotionKitError(
            f"--style {args.style}: no such file; {method.name} takes its style from a BVH file. By name: "
            "--method style-code or --method style-erd"
        )
    return method, load(args.style, args.metres_per_unit)


def _perform(args: argparse.Namespace) -> None:
    from . import actor

    output = _fresh(args.output, ".bvh", [])
    who = int(args.performer) if (args.performer or "").isdigit() else args.performer
    made = actor.perform(
        args.content, args.style, args.seed, seconds=args.seconds, intensity=args.intensity, performer=who
    )
    print(save(made.motion, output))
    print(made.captions[0])


def _imagine(args: argparse.Namespace) -> None:
    from .methods import text_to_motion

    output = _fresh(args.output, ".bvh", [])
    scale = text_to_motion.GUIDANCE_SCALE if args.scale is None else args.scale
    motions = text_to_motion.load(args.prior).generate(args.sentence, args.seconds, scale=scale, seed=args.seed)
    print(save(motions[0], output))


def _learn(args: argparse.Namespace) -> None:
    output = _fresh(args.output, ".safetensors", [args.style])
    there = f"{args.prior}-style-code" in checkpoints.names()
    name = args.method or ("style-code" if there else "few-shot")
    library = datasets.load(args.prior, args.root).split().train if args.root else None
    method = methods.load(name, prior=args.prior, library=library, seed=args.seed)
    why = "" if args.method else f"; {args.prior!r} has {'' if there else 'no '}codes of styles"
    print(f"learning by {name}: {_LEARNS[name]}{why}")
    running, clip = {"resume": output.with_suffix(".run")}, load(args.style, args.metres_per_unit)
    if name == "few-shot":
        method = method.with_config(steps=args.steps) if args.steps else method
    elif args.steps:
        running["steps"] = args.steps
    print(method.learn(clip, args.prompt, **running).save(output))


_LEARNS = {
    "style-code": "the kit's own method reads a style's code off the clip, in seconds",
    "few-shot": "paper 1's method fine-tunes its prior, in a minute or two",
}


def _fresh(output: str | Path, suffix: str, inputs: list[str]) -> Path:
    """The file to write; refuses one that is read here, and names that would tell other programs something wrong."""
    path = target(output)
    if any(path.resolve() == Path(f).resolve() for f in inputs):
        raise MotionKitError(f"{path}: this file is read here and would be lost; write to another one with -o")
    if path.suffix.lower() != suffix:
        raise MotionKitError(f"{path}: what is written is a {suffix} file; name it so")
    return path


_COMMANDS = {
    "info": _info,
    "play": _play,
    "stylize": _stylize,
    "perform": _perform,
    "imagine": _imagine,
    "learn": _learn,
    "train": _train,
}


def main(arguments: list[str] | None = None) -> int:
    """Run one command; errors that the user can put right are one line on stderr and exit code 2.

    >>> main(["info", "nowhere.bvh"])
    2
    """
    args = _parser().parse_args(arguments)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always", MotionKitWarning)
            warnings.showwarning = lambda message, *_: print(f"motionkit: {message}", file=sys.stderr)
            _COMMANDS[args.command](args)
    except MotionKitError as error:
        print(f"motionkit: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # `... | head` has read enough
        sys.stderr.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
