"""The parameters: declared once, validated into settings, read from files, written as reference."""
