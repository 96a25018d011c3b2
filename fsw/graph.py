from typing import Any
class Graph:
    def __init__(self, tasks: Any) -> None: self.tasks=tasks
    def require_sound(self) -> None: pass
