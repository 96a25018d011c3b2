"""Messages: what ports carry. One file per domain; `messages.base` says how they are declared."""
