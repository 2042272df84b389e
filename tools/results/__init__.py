"""Parts of tools/update_results."""
