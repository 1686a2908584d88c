"""FMUs in processes of their own: a C library that forwards FMI calls, and the processes that make them."""
