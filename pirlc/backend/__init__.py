"""Controllers to files: one module a target; `toolchain` compiles and loads the C."""
