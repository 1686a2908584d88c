"""Kernels that benchmarks time. They form a package, because the machine code of kernels in packages is kept."""
