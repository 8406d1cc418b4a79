"""What came out: `Result`, how the solve went, its certificate, saving and loading.

Starts from ψ alone and uses nothing of the solver, so that it can check it.
May know problem and output, to which a result hands itself.
"""
