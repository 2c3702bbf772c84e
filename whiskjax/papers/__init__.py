"""The three papers that whiskjax began with, reproduced: their printed values, studies, findings and pages, and only that."""
