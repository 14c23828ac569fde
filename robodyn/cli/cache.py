"""Show where compiled kernels, and what was the cheapest formalism, are kept and how much room they take; or remove them.

The environment variable ROBODYN_CACHE names another folder, or turns the cache "off".
"""

import argparse

from ..system import cache


def arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument(
        "--clear",
        action="store_true",
        help="remove every entry, and what interrupted writes have left; kernels are compiled again when needed",
    )


def run(options: argparse.Namespace) -> int:
    """Show or clear."""
    if (folder := cache.folder()) is None:
        print("the cache is off, or its folder is not the user's own")
        return 0
    number, size = cache.clear() if options.clear else cache.usage()
    print(f"{'removed' if options.clear else folder}: {number} entries, {size / 2**20:.1f} MB")
    return 0
