"""Every command as a function: files in, a typed result out, nothing printed."""
