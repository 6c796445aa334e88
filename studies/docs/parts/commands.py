"""The help of every subcommand of `orbits`, as it prints it."""

import click
from docutils import nodes
from sphinx.util.docutils import SphinxDirective

WIDTH = 88  # columns that fit into a page


def helps(command: click.Command, name: str):
    """The names and help texts of a command and its subcommands."""
    context = click.Context(command, info_name=name, max_content_width=WIDTH, terminal_width=WIDTH)
    yield name, command.get_help(context)
    if isinstance(command, click.Group):
        for sub in command.list_commands(context):
            yield from helps(command.get_command(context, sub), f"{name} {sub}")


class Commands(SphinxDirective):
    """A section for each subcommand."""

    def run(self):
        from problems.command.cli import orbits

        self.env.note_reread()  # what it shows may change without the page
        sections = []
        for name, text in helps(orbits, "orbits"):
            section = nodes.section("", nodes.title("", name), ids=[nodes.make_id(name)], names=[name])
            section += nodes.literal_block(text, text, language="output")
            self.state.document.note_explicit_target(section)
            sections.append(section)
        return sections


def setup(app) -> dict:
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
