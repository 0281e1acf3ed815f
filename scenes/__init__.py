"""The bundled scenes (TOML) and their meshes (OBJ)."""
