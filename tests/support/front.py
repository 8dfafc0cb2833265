"""What the package's front offers, by name."""

import inspect

import microvib as mv


def public_functions():
    """Functions of the front, and methods of its classes, by their names."""
    for name in mv.__all__:
        if name == "__version__":
            continue
        given = getattr(mv, name)
        if inspect.isclass(given):
            if "__init__" in vars(given) and not issubclass(given, Exception):
                yield name, given
            for key, member in vars(given).items():
                function = getattr(member, "__func__", member)
                if not key.startswith("_") and inspect.isfunction(function):
                    yield f"{name}.{key}", function
        else:
            yield name, given


PUBLIC = dict(public_functions())
