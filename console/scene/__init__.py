"""The 3D scene: arms, object, gizmos, previews."""
