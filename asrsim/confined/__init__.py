"""Scripts on untrusted files, in processes of their own with limited time and memory."""
