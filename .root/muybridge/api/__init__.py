"""The public interface, on top of every other package; import its names from `muybridge`.

`muybridge/__init__.pyi` lists them, `docs/reference/api-policy.md` says what is stable. Nothing inside the project
imports this package.
"""
